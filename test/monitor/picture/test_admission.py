# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""An attacker who has the link and knows the format: what is forged, replayed and reordered."""

import struct

from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
from cryptography.hazmat.primitives.serialization import (
    Encoding,
    NoEncryption,
    PrivateFormat,
    PublicFormat,
)
import pytest
from stream_pieces import make_rows, NO_TABLES, Source

from plc_inspect.errors import ConfigError
from plc_inspect.monitor.picture.admission import Admission, KEPT, LEAP, SILENT
from plc_inspect.monitor.picture.model import Monitor
from plc_inspect.monitor.picture.wishes import OVERTAKEN
from plc_inspect.stream import frame
from plc_inspect.stream.frame import Frame, pack_frame, SUMMARY, unpack_frame
from plc_inspect.stream.signature import OVERHEAD, Signer, Verifier


def make_key():
    """Return an Ed25519 key as private and public PEM."""
    key = Ed25519PrivateKey.generate()
    private = key.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, NoEncryption())
    return private, key.public_key().public_bytes(
        Encoding.PEM, PublicFormat.SubjectPublicKeyInfo
    )


PRIVATE, PUBLIC = make_key()
OTHER_PRIVATE, OTHER_PUBLIC = make_key()


class Node:
    """A node that signs its stream."""

    def __init__(self, run=5, session=7, resets=0, private=PRIVATE):
        self.source, self.signer = Source(session, resets), Signer(private, run)

    def summary(self, uptime, **options):
        """Return the next message."""
        return self.signer.sign(self.source.summary(uptime, **options))

    def cloud(self, uptime):
        """Return the next message of the corridor."""
        return self.signer.sign(self.source.cloud(uptime))


@pytest.fixture
def node():
    """Return a node."""
    return Node()


@pytest.fixture
def monitor(node):
    """Return a monitor with keys that has had ten messages of the node until time 109."""
    monitor = Monitor(admission=Admission(Verifier(OTHER_PUBLIC + PUBLIC)))
    for k in range(10):
        assert monitor.take_summary(node.summary(5.0 + k, keyframe=not k), 100.0 + k)
    return monitor


def look(monitor):
    """Return what is shown and must not change."""
    picture = monitor.look(110.0)
    return picture.spans, picture.hazards, picture.session, picture.vehicle, picture.complete


def test_signatures_are_checked_byte_by_byte():
    message = Node().summary(5.0, keyframe=True)
    verifier = Verifier(OTHER_PUBLIC + PUBLIC)
    assert verifier.check(message).run == 5
    plain = Source().summary(5.0, keyframe=True)
    assert len(message) == len(plain) + OVERHEAD
    assert unpack_frame(message, SUMMARY).body == unpack_frame(plain, SUMMARY).body
    for k in range(len(message)):
        changed = message[:k] + bytes([message[k] ^ 1]) + message[k + 1:]
        assert verifier.check(changed) is None, k
    for cut in range(len(message)):
        assert verifier.check(message[:cut]) is None
    assert Verifier(OTHER_PUBLIC).check(message) is None


def test_keys_that_are_none_are_told():
    for pem in (b'', b'nonsense', PRIVATE, PUBLIC[:60] + PUBLIC[80:]):
        with pytest.raises(ConfigError):
            Verifier(pem)
    for pem in (b'', PUBLIC):
        with pytest.raises(ConfigError):
            Signer(pem, 1)


def test_nothing_forged_is_taken(monitor, node):
    before = look(monitor)
    plain = Source(7)
    forged = [
        plain.summary(99.0, keyframe=True, tables=NO_TABLES),
        Source(999).summary(1.0, keyframe=True, tables=NO_TABLES),
        Source(8, resets=1).summary(20.0, keyframe=True, tables=NO_TABLES),
        pack_frame(Frame(kind=SUMMARY, flags=0x81, session=7, sequence=2**32 - 1, uptime=9.0,
                         body=unpack_frame(plain.summary(9.0), SUMMARY).body)),
        Signer(make_key()[0], 99).sign(plain.summary(99.0, keyframe=True)),
    ]
    good = node.summary(15.0)
    forged += [good[:10] + struct.pack('<I', 4_000_000_000) + good[14:]]
    for data in forged:
        assert not monitor.take_summary(data, 109.5)
    assert not monitor.take_cloud(plain.cloud(9.0), 109.5)
    assert look(monitor) == before
    assert monitor.look(110.0).counts.forged == len(forged) + 1
    assert 'refused 7 forged' in monitor.look(110.0).counts.describe_refused()
    assert monitor.take_summary(good, 110.0)


def test_no_alarm_is_raised_by_who_has_no_key(monitor, node):
    rows = make_rows(6, 4)
    alarmed = [item.key for item in monitor.look(110.0).alarms]
    forged = [
        Source().summary(20.0, tables=rows),
        Node(private=OTHER_PRIVATE).summary(20.0, tables=rows),
        Node(run=4).summary(20.0, tables=rows),
        Node(session=8).summary(20.0, tables=rows),
    ]
    for data in forged:
        monitor.take_ahead(data, 110.0)
    assert [item.key for item in monitor.look(110.0).alarms] == alarmed
    monitor.take_ahead(node.summary(20.0, tables=rows), 110.0)
    assert len(monitor.look(110.0).alarms) == len(alarmed) + 1


def test_of_who_has_no_key_nothing_is_unpacked(monitor, node, monkeypatch):
    unpacked = []
    monkeypatch.setattr(frame.zlib, 'decompressobj', lambda: unpacked.append(1))
    good = node.summary(15.0)
    changed = good[:4] + b'\7' + good[5:]
    for data in (b'', b'nonsense', good[:-1], good[:40], good + b'\0', changed):
        assert not monitor.take_summary(data, 109.5)
        assert not monitor.take_cloud(data, 109.5)
    assert not unpacked
    counts = monitor.look(110.0).counts
    assert (counts.forged, counts.malformed) == (12, 0)


def test_nothing_replayed_is_taken_not_even_an_earlier_flight(monitor, node):
    yesterday = Node(run=4, session=1)
    recorded = [yesterday.summary(k, keyframe=not k, tables=NO_TABLES) for k in range(5)]
    before = look(monitor)
    again = Node()
    for k in range(10):
        assert not monitor.take_summary(again.summary(5.0 + k, keyframe=not k), 109.5)
    for data in recorded:
        assert not monitor.take_summary(data, 109.5)
        assert not monitor.take_summary(data, 150.0)  # nor when the node has long been silent
    assert look(monitor) == before
    assert monitor.look(110.0).counts.replayed == 20
    assert monitor.take_summary(node.summary(60.0), 151.0)


def test_an_earlier_flight_is_not_taken_by_a_monitor_that_saw_a_later(monitor):
    runs = monitor._admission.runs
    fresh = Monitor(admission=Admission(Verifier(PUBLIC), dict(runs)))
    assert not fresh.take_summary(Node(run=4).summary(1.0, keyframe=True), 10.0)
    assert fresh.take_summary(Node(run=5).summary(1.0, keyframe=True), 10.0)


def test_reordered_messages_are_counted_and_not_used(monitor, node):
    messages = [node.summary(20.0 + k, tables=make_rows(6, k % 4)) for k in range(6)]
    for k in (1, 0, 3, 2, 5, 4):
        monitor.take_summary(messages[k], 110.0)
    counts = monitor.look(110.0).counts
    assert (counts.reordered, counts.replayed, counts.lost_summary) == (3, 0, 3)
    assert not monitor.take_summary(messages[1], 110.1)
    assert monitor.look(110.1).counts.replayed == 1


def test_on_request_only_the_newest_may_come_again(monitor, node):
    for k in range(40):
        monitor.take_summary(node.summary(20.0 + k), 110.0 + k)
    kept = [node.summary(60.0 + k, keyframe=not k) for k in range(3)]
    monitor.take_summary(kept[-1], 152.0)
    assert monitor.take_wishes(152.0 + OVERTAKEN) == {'summary'}
    old = Node()
    replayed = [old.summary(5.0 + k, keyframe=not k) for k in range(53 - KEPT - 1)]
    assert not any(monitor.take_summary(data, 152.4) for data in replayed)
    assert all(monitor.take_summary(data, 152.5) for data in kept)
    assert monitor.look(152.6).complete


def test_restarts_and_resets_that_are_signed_are_taken_at_once(monitor):
    reset = Node(session=8, resets=1)
    assert monitor.take_summary(reset.summary(16.0, keyframe=True, tables=NO_TABLES), 109.1)
    assert not monitor.take_summary(Node().summary(17.0, keyframe=True), 109.2)  # before it
    restarted = Node(run=6, session=3)
    assert monitor.take_summary(restarted.summary(0.5, keyframe=True, tables=NO_TABLES), 109.3)
    assert monitor.take_cloud(restarted.cloud(0.6), 109.4)
    picture = monitor.look(109.5)
    assert picture.counts.restarts == 2
    assert picture.counts.replayed == 1


def test_of_two_vehicles_the_one_that_was_there_is_shown(monitor, node):
    second = Node(run=900, session=70, private=OTHER_PRIVATE)
    assert not monitor.take_summary(second.summary(1.0, keyframe=True), 109.5)
    assert monitor.look(109.6).counts.foreign == 1
    assert monitor.take_summary(node.summary(15.0), 110.0)
    assert monitor.take_summary(second.summary(9.0, keyframe=True), 110.1 + SILENT)


def test_without_keys_no_single_message_silences_the_node():
    source, monitor = Source(), Monitor()
    monitor.take_summary(source.summary(5.0, keyframe=True), 100.0)
    forger = Source(999)
    monitor.take_summary(forger.summary(1.0, keyframe=True, tables=NO_TABLES), 100.5)
    leap = Source()
    leap.writer._sequence = 10 + LEAP + 60
    assert not monitor.take_summary(leap.summary(6.0, keyframe=True, tables=NO_TABLES), 100.6)
    assert monitor.take_summary(source.summary(6.0), 101.0)
    counts = monitor.look(101.0).counts
    assert (counts.foreign, counts.forged) == (1, 1)
    # A number that leaps a little is taken, and the node comes back when it would be silent.
    leap.writer._sequence = 60
    assert monitor.take_summary(leap.summary(6.0, keyframe=True, tables=NO_TABLES), 101.5)
    assert not monitor.take_summary(source.summary(7.0), 102.0)
    assert not monitor.take_summary(source.summary(8.0), 103.0)
    assert monitor.take_summary(source.summary(9.0, keyframe=True), 104.1)
    assert len(monitor.look(104.2).spans) == 6


def test_after_a_forged_number_the_nodes_are_no_resend():
    admission, data = Admission(), b''

    def judge(number, now):
        frame = Frame(kind=SUMMARY, flags=0, session=7, sequence=number, uptime=1.0, body=data)
        return admission.judge(frame, data, now, 0)

    for number in range(5):
        assert judge(number, float(number)).good
    assert judge(60, 4.5).good  # forged
    admission.reopen(SUMMARY)
    assert not judge(5, 5.0).good
    later = judge(8, 4.6 + SILENT)
    assert (later.good, later.resent) == (True, False)
    admission.reopen(SUMMARY)
    assert [judge(number, 8.0).resent for number in (5, 6, 7, 8, 9)] == [True] * 3 + [False] * 2


def test_a_reset_is_followed_at_once_where_the_corridor_came_first():
    before, after, monitor = Source(), Source(8, resets=1), Monitor()
    assert monitor.take_cloud(before.cloud(5.0), 100.0)
    assert monitor.take_summary(before.summary(5.1, keyframe=True), 100.1)
    assert monitor.take_summary(after.summary(5.2, keyframe=True, tables=NO_TABLES), 100.2)
    assert monitor.look(100.3).counts.foreign == 0


def test_what_was_kept_from_before_a_reset_is_no_attack():
    before, after, monitor = Source(), Source(8, resets=1), Monitor()
    kept = [before.summary(5.0, keyframe=True), before.summary(6.0),
            after.summary(7.0, keyframe=True, tables=NO_TABLES)]
    assert all(monitor.take_summary(data, 100.0) for data in kept)
    after.summary(8.0)
    kept.append(after.summary(9.0))
    monitor.take_summary(kept[-1], 102.0)
    assert monitor.take_wishes(102.0 + OVERTAKEN) == {'summary'}
    assert [monitor.take_summary(data, 102.4) for data in kept] == [False, False, True, True]
    assert monitor.look(102.5).counts.describe_refused() == ''


def test_what_comes_again_after_joining_anew_is_no_attack(monitor, node):
    again = Node()
    kept = [again.summary(5.0 + k, keyframe=not k) for k in range(10)]
    monitor.rejoin()
    assert all(monitor.take_summary(data, 120.0) for data in kept)
    assert monitor.take_summary(node.summary(26.0), 120.5)
    assert monitor.look(121.0).counts.describe_refused() == ''
