# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""The page in a real browser, of a stream made by hand."""

import contextlib
import io
import itertools
import json
from pathlib import Path
import socket
import threading
import time

from monitor.web.chrome import EYES, LEAST_DISTANCE, see
from monitor.web.flight import ALARMS, HAZARDS, STATE, TONE
import numpy as np
from PIL import Image
import pytest
from stream_pieces import make_rows, Source

from plc_inspect.colors import LOOKS
from plc_inspect.core.live.proximity import Level, Thing
from plc_inspect.monitor.picture.model import Monitor
from plc_inspect.monitor.replay.replay import Replay
from plc_inspect.monitor.replay.tape import Entry, Tape
from plc_inspect.monitor.web.access import NO_TOKENS, Role, Tokens
from plc_inspect.monitor.web.pace import Pace
from plc_inspect.monitor.web.page import Page
from plc_inspect.stream.nearness import Nearness

ROOT = Path(__file__).parents[3]
AXE = ROOT / 'test' / 'npm' / 'node_modules' / 'axe-core' / 'axe.min.js'
TARGET = """(([x, y, z], [a, b, c]) => [x + a, y + b, z + c])(
station.scene.controls.target.toArray(), station.scene.origin)"""
WIRE = Nearness(
    thing=Thing.CONDUCTOR, level=Level.CRITICAL, distance=4.2, way=(1.0, 2.0, -3.0), closest=4.0,
    closest_in=2.0, sigma=0.1, line_id=1, span_id=0,
)
BUTTONS = """[...document.querySelectorAll('#alarms button:not(.what)')].filter(
item => item.checkVisibility()).map(item => item.textContent)"""
SHOWN = """(bar => [...document.querySelectorAll('#alarm-list li')].filter(
row => row.checkVisibility() && row.getBoundingClientRect().bottom
<= bar.getBoundingClientRect().bottom).length)(document.querySelector('#alarms'))"""
FARTHEST = """Math.max(...station.scene.spans.flatMap(
span => [span.curve[0], span.curve.at(-1)]).map(
place => station.scene.local(place).project(station.scene.camera)).flatMap(
at => [Math.abs(at.x), Math.abs(at.y)]))"""
SILENT_BELL = """globalThis.rung = 0; station.alarms.audio = {
  currentTime: 0, state: 'running', resume: () => Promise.resolve(),
  createOscillator: () => ({frequency: {value: 0}, connect: () => ({connect() {}}),
    start() { globalThis.rung++; }, stop() {}}),
  createGain: () => ({gain: {setValueAtTime() {}, exponentialRampToValueAtTime() {}}}),
}; for (let k = 1; k < 9999; k++) clearInterval(k)"""
"""Counts tones, which come by the page's news alone."""
WITHIN = 1.0
"""An alarm is on the screen so soon after the node's message [s]."""


class Station:
    """A page of a stream made by hand, in a thread of its own."""

    def __init__(self, tokens=NO_TOKENS):
        self.monitor, self.source, self.period = Monitor(), Source(), 0.2
        self.tables, self.status = make_rows(6, 3), {}
        self.page = Page('127.0.0.1', 0, tokens)
        self.began, self.ended = time.monotonic(), threading.Event()
        self.silent = False
        self.thread = threading.Thread(target=self._run)
        self.thread.start()

    def _run(self):
        number = 0
        while not self.ended.is_set():
            now = time.monotonic()
            if not self.silent:
                self.monitor.take_summary(self.source.summary(
                    now - self.began, keyframe=number % 20 == 0, tables=self.tables,
                    near_uptime=now - self.began, **self.status,
                ), now)
                number += 1
            for request in self.page.take_requests():
                self.monitor.acknowledge(request.numbers, request.who, now)
            self.page.show('/plc_inspect', self.monitor.look(now), self.monitor.cloud)
            self.ended.wait(self.period)

    def stop(self):
        """Show nothing more."""
        self.ended.set()
        self.thread.join()

    def close(self):
        self.stop()
        self.page.__exit__(None, None, None)


@pytest.fixture
def station():
    """Return a page that somebody may acknowledge on, and others only view."""
    station = Station(Tokens({Role.ACKNOWLEDGE: 'token to be shown', Role.VIEW: 'only looking'}))
    yield station
    station.close()


@pytest.mark.slow
def test_a_page_that_draws_long_answers_at_once(station, browse, monkeypatch):
    answered, answer = [], Pace.answer

    def note(pace, now):
        answered.append(now)
        answer(pace, now)

    monkeypatch.setattr(Pace, 'answer', note)
    desk = browse(station.page.address, token='only looking')
    desk.wait(f'{ALARMS}.length == 1')
    threading.Timer(1.0, setattr, (station, 'tables', make_rows(6, 5))).start()
    began = time.monotonic()
    desk.run('(end => { while (performance.now() < end); })(performance.now() + 5000)')
    assert [now for now in answered if began + 1.0 < now < began + 4.0]
    desk.wait(f'{HAZARDS}.length == 5')


@pytest.mark.slow
def test_alarms_are_seen_acknowledged_and_cleared(station, browse):
    desk = browse(station.page.address, 1280, 800, token='token to be shown')
    other = browse(station.page.address, 390, 844, token='only looking', phone=True)
    desk.wait(f'{ALARMS}.length == 1')
    assert desk.run(TONE) == 'ok'
    assert desk.run(STATE) == 'live: scans at 10.0 Hz and poses come in, the map is sharp'
    sent = time.monotonic()
    station.status = {'near': (WIRE,), 'heading': 0.5}
    desk.wait(f'{ALARMS}.length == 2')
    assert time.monotonic() - sent < WITHIN + station.period
    assert desk.run('document.querySelector("#nearest").textContent') == '4.2 m TOO NEAR'
    assert desk.run("document.querySelector('#alarm-sum').textContent") == (
        '2 critical, 1 warning, 2 not acknowledged'
    )
    assert desk.page.title().startswith('(2) ALARM')
    assert desk.run("document.querySelector('#icon').dataset.tone") == 'critical'
    bar = desk.run("document.querySelector('#alarms').getBoundingClientRect().width")
    assert bar == 1280
    other.wait(f'{ALARMS}.length == 2')
    assert other.run(f'{BUTTONS}.length') == 0  # it may only view

    desk.page.keyboard.press('a')  # all by the keyboard
    desk.page.keyboard.type('crew')
    desk.page.keyboard.press('Enter')
    for chrome in (desk, other):
        chrome.wait(f"{ALARMS}.every(([state]) => state == 'acknowledged')")
        assert 'seen by crew' in chrome.run("document.querySelector('#alarms').textContent")
    assert desk.page.title().startswith('2 critical')
    assert desk.run("document.querySelector('#alarms').dataset.unseen") == '0'

    station.status, station.tables = {}, make_rows(6, 0)
    desk.wait("document.querySelector('#alarms').hidden")
    log = desk.run("document.querySelector('#past').textContent")
    assert log.count('seen by crew') == 2
    assert desk.run("document.querySelector('#icon').dataset.tone") == 'ok'

    station.tables = make_rows(6, 1)  # raised anew: nobody has seen this one
    desk.wait(f"{ALARMS}.some(([state]) => state == 'new')")
    station.tables = make_rows(6, 0)
    desk.wait(f"{ALARMS}.some(([state]) => state == 'cleared')")
    time.sleep(1.0)
    assert len(desk.run(ALARMS)) == 1


@pytest.mark.slow
def test_hazards_that_are_held_back_are_shown_so(station, browse):
    desk = browse(station.page.address, 1280, 800, token='token to be shown')
    age = "document.querySelector('#hazards-age').textContent"
    desk.wait(f'{ALARMS}.length == 1')
    desk.wait(f"{age}.startsWith('3 hazards') && !{age}.includes('HELD')")
    station.status, station.tables = {'held': True}, make_rows(6, 0)
    desk.wait(f"{age}.includes('HELD BACK, as told last: map is not sharp')")
    assert desk.run(age).startswith('3 hazards')
    assert [state for state, _ in desk.run(ALARMS)] == ['new']
    assert 'held back, as told last' in desk.run("document.querySelector('#alarms').textContent")
    assert desk.run(TONE) == 'critical'
    station.status = {}
    desk.wait(f"{age}.startsWith('0 hazards') && !{age}.includes('HELD')")
    desk.wait(f"{ALARMS}.some(([state]) => state == 'cleared')")


@pytest.mark.slow
def test_no_alarm_is_cut_off_silently(station, browse):
    station.tables = make_rows(9, 9)
    station.tables.hazards['severity'] = 3
    chrome = browse(station.page.address, token='token to be shown')
    chrome.wait(f'{ALARMS}.length == 9')
    for size in (1, 2, 3):
        for width, height in ((1920, 1080), (1024, 768), (390, 844)):
            chrome.page.set_viewport_size({'width': width, 'height': height})
            chrome.page.wait_for_timeout(300)
            shown = chrome.run(SHOWN)
            assert 1 <= shown < 9
            assert sorted(chrome.run(BUTTONS)) == [
                f'+ {9 - shown} more', *shown * ['Acknowledge'], 'Acknowledge all'
            ]
            assert chrome.page.locator('#picture').bounding_box()['height'] > 0.2 * height
            chrome.page.click('#alarm-more')
            assert chrome.run(BUTTONS).count('Acknowledge') == 9
            assert chrome.page.locator('#alarms').bounding_box()['height'] < 0.75 * height
            chrome.page.locator('#alarm-list .seen').nth(8).scroll_into_view_if_needed()
            chrome.page.click('#alarm-more')
            assert chrome.run(SHOWN) == shown
        chrome.page.click('#size')
        chrome.wait(f"document.documentElement.dataset.size == '{size % 3 + 1}'")


@pytest.mark.slow
def test_what_was_known_before_a_restart_stays_in_the_bar(station, browse):
    desk = browse(station.page.address, token='token to be shown')
    desk.wait(f'{ALARMS}.length == 1')
    station.source, station.tables = Source(session=99), make_rows(6, 0)
    desk.wait(f"{ALARMS}[0][0] == 'unsure'")
    text = desk.run("document.querySelector('#alarms').textContent")
    assert '0 critical, 1 may still be there' in text
    assert 'MAY STILL BE THERE' in text
    line = "getComputedStyle(document.querySelector('#alarm-list .what')).textDecorationLine"
    assert desk.run(line) == 'underline'
    assert desk.page.title().startswith('(1) ALARM')
    row = desk.page.locator('#alarm-list li').element_handle()
    station.tables = make_rows(6, 1)  # the same hazard again: the same row
    desk.wait(f"{ALARMS}[0][0] == 'new'")
    assert row.evaluate('item => item.isConnected')


@pytest.mark.slow
def test_help_opens_at_its_beginning(station, browse):
    phone = browse(station.page.address, 390, 500, token='only looking', phone=True)
    phone.page.click('#help-button')
    assert phone.run("document.querySelector('#help').scrollTop") == 0
    assert phone.run("document.querySelector('#help').scrollHeight") > 500


@pytest.mark.slow
def test_the_picture_is_steered_by_pointer_and_keyboard(station, browse):
    desk = browse(station.page.address, 1280, 800, token='token to be shown')
    hazard = station.monitor.look(time.monotonic()).hazards[1]
    desk.wait(f'{HAZARDS}.length == 3')
    desk.page.click(f'#hazards tr[data-hazard="{hazard.hazard_id}"] button')
    np.testing.assert_allclose(desk.run(TARGET), hazard.position, atol=0.01)  # flown there
    detail = "document.querySelector('#hazard h2')?.dataset.hazard"
    assert desk.run(detail) == str(hazard.hazard_id)
    for key, view in (('f', 'follow'), ('o', 'overview'), ('t', 'top'), ('s', 'side')):
        desk.page.keyboard.press(key)
        pressed = "[...document.querySelectorAll('[data-view][aria-pressed=true]')]"
        assert desk.run(f'{pressed}.map(item => item.dataset.view)') == [view]
        if view != 'follow':
            assert 0.7 < desk.run(FARTHEST) < 0.95
    desk.page.keyboard.press('2')
    desk.page.click('#spans tr[data-span="1/0"] button')
    desk.wait("document.querySelector('#profile h2')?.dataset.span == '1/0'")
    assert desk.run("document.querySelectorAll('#profile svg circle').length") == 1
    desk.page.keyboard.press('1')
    desk.page.click('#alarm-list .what')  # an alarm leads to its hazard
    desk.wait(f"{detail} == '0'")
    desk.page.click(f'#hazards tr[data-hazard="{hazard.hazard_id}"] button')
    desk.wait(f"{detail} == '{hazard.hazard_id}'")
    box = desk.page.locator('#canvas').bounding_box()
    desk.page.mouse.click(box['x'] + box['width'] / 2, box['y'] + box['height'] / 2)
    desk.wait(f"{detail} != ''")
    before = desk.run('station.scene.camera.position.toArray()')
    desk.page.focus('#canvas')
    desk.page.keyboard.press('ArrowLeft')
    desk.page.keyboard.press('+')
    assert desk.run('station.scene.camera.position.toArray()') != before


def test_ways_and_curves_are_drawn_with_few_pieces(station, browse):
    desk = browse(station.page.address, 1280, 800, token='token to be shown')
    desk.wait("performance.getEntriesByName('picture').length")
    way = [(float(x), 0.1 * (x % 2), 30.0) for x in range(300)]  # straight, as measured
    way += [(299.0, float(y), 30.0) for y in range(1, 50)]
    short = desk.run(f"""(async () => {{
      const {{straighten}} = await import('/scene.js'), {{Vector3}} = await import('three');
      const places = {json.dumps(way)}.map(place => new Vector3(...place));
      return straighten(places).map(place => place.toArray());
    }})()""")
    np.testing.assert_allclose(short[0], way[0])
    np.testing.assert_allclose(short[-1], way[-1])
    assert len(short) <= 4
    assert min(np.linalg.norm(np.subtract(place, (299.0, 0.0, 30.0))) for place in short) < 0.5
    pieces = 'station.scene.parts.spans.geometry.instanceCount'
    desk.run('station.scene.goTo(station.tables.spans[0].curve[0]); station.scene.drawSpans()')
    near = desk.run(pieces)
    desk.run('station.scene.camera.position.z += 3000; station.scene.drawSpans()')
    assert desk.run(pieces) == 6 < near  # straight, each of its six spans


@pytest.mark.slow
def test_a_page_without_a_picture_keeps_no_points_for_it(station, browse):
    chrome = browse(station.page.address, 800, 600, token='only looking')
    chrome.page.add_init_script('HTMLCanvasElement.prototype.getContext = () => null')
    chrome.page.reload()
    chrome.wait("!document.querySelector('#no-picture').hidden")
    station.monitor.take_cloud(station.source.cloud(1.0), time.monotonic())
    station.tables = make_rows(6, 4)
    chrome.wait(f'{HAZARDS}.length == 4')
    chrome.page.wait_for_timeout(500)
    assert not chrome.run('station.waiting')


@pytest.mark.slow
def test_all_times_are_of_the_clock_of_the_monitor(station, browse):
    chrome = browse(station.page.address, 800, 600, token='only looking')
    chrome.page.add_init_script('{ const now = Date.now; Date.now = () => now() - 3 * 3600000; }')
    chrome.page.reload()
    chrome.wait("document.querySelector('#now').textContent")

    def lies_near():
        text = chrome.run("document.querySelector('#now').textContent")
        told = chrome.run(f'new Date({1000.0 * time.time()}).toLocaleTimeString("en-GB")')
        hours, minutes, seconds = (
            int(one) - int(other)
            for one, other in zip(text.split(':'), told.split(':'), strict=True)
        )
        return abs(3600 * hours + 60 * minutes + seconds) < 30

    end = time.monotonic() + 10.0
    while not lies_near():
        assert time.monotonic() < end
        chrome.page.wait_for_timeout(200)


@pytest.mark.slow
def test_sound_is_said_to_be_on_only_where_it_plays(station, browse):
    chrome = browse(station.page.address, 800, 600, token='only looking')
    button = "document.querySelector('#sound').textContent"
    chrome.page.keyboard.press('1')
    chrome.wait(f"{button} == 'Sound on'")
    chrome.run('station.alarms.audio.suspend()')  # as browsers do after a call or a sleep
    chrome.wait(f"{button} == 'Sound: press once'")
    chrome.page.keyboard.press('1')
    chrome.wait(f"{button} == 'Sound on'")


@pytest.mark.slow
def test_a_page_that_gets_nothing_says_so(station, browse):
    chrome = browse(station.page.address, 800, 600, token='only looking')
    station.silent = True
    chrome.wait(f"{STATE}.startsWith('link late')")
    station.stop()
    chrome.wait(f"{STATE}.startsWith('FROZEN')")
    assert chrome.run(TONE) == 'critical'
    assert chrome.run("document.body.classList.contains('old')")


@pytest.mark.slow
def test_a_page_keeps_its_vehicle_when_it_connects_again(browse):
    def show(page, vehicle, count):
        monitor = Monitor()
        monitor.take_summary(
            Source().summary(1.0, keyframe=True, tables=make_rows(6, count)), time.monotonic()
        )
        page.show(vehicle, monitor.look(time.monotonic()), monitor.cloud)

    with Page('127.0.0.1', 0) as page:
        show(page, '/uav1', 4)
        chrome = browse(page.address)
        chrome.wait(f'{HAZARDS}.length == 4')
        port = int(page.address.split(':')[-1].strip('/'))
    with Page('127.0.0.1', port) as page:
        show(page, '/uav1', 5)
        show(page, '/uav0', 3)  # the first one now
        show(page, '/uav1', 5)
        chrome.wait(f'[3, 5].includes({HAZARDS}.length)')
        assert chrome.run(f'{HAZARDS}.length') == 5


@pytest.mark.slow
def test_a_page_of_a_vehicle_that_is_not_there_says_so_until_it_comes(browse):
    def show(page, vehicle):
        monitor = Monitor()
        monitor.take_summary(
            Source().summary(1.0, keyframe=True, tables=make_rows(6, 4)), time.monotonic()
        )
        page.show(vehicle, monitor.look(time.monotonic()), monitor.cloud)

    with Page('127.0.0.1', 0) as page:
        show(page, '/uav1')
        chrome = browse(f'{page.address}?vehicle=/uav7')
        chrome.wait(f"{STATE} == 'no vehicle /uav7 is known: /uav1 when this page was opened'")
        show(page, '/uav7')
        chrome.wait(f'{HAZARDS}.length == 4')


@pytest.mark.slow
def test_an_alarm_of_a_monitor_from_before_is_not_acknowledged_on_another(browse):
    def show(page, first):
        monitor, tables = Monitor(), make_rows(6, 1)
        tables.hazards['hazard_id'] = first
        monitor.take_summary(
            Source().summary(1.0, keyframe=True, tables=tables), time.monotonic()
        )
        page.show('/plc_inspect', monitor.look(time.monotonic()), monitor.cloud)

    with Page('127.0.0.1', 0) as page:
        show(page, 7)
        chrome = browse(page.address)
        chrome.wait(f"{ALARMS}[0]?.[1].includes('hazard 7')")
        port = int(page.address.split(':')[-1].strip('/'))
        chrome.page.click('#alarm-list .seen')  # it asks for a name
    with Page('127.0.0.1', port) as page:
        show(page, 8)  # also the first alarm
        chrome.wait(f"{ALARMS}[0]?.[1].includes('hazard 8')")
        chrome.page.fill('#name', 'crew')
        chrome.page.click('#who button[type=submit]')
        told = "document.querySelector('#alarm-sum').textContent"
        chrome.wait(f"{told} == 'NOT acknowledged: the monitor was started anew meanwhile'")
        assert page.take_requests() == []
        chrome.page.click('#alarm-list .seen')
        end = time.monotonic() + 10.0
        while not (requests := page.take_requests()):
            assert time.monotonic() < end
            chrome.page.wait_for_timeout(50)
        assert [(item.numbers, item.who) for item in requests] == [((1,), 'crew')]


class DeadEnd:
    """A way to a port, on which connections can die without a word to the browser."""

    def __init__(self, port):
        self.port, self.pairs, self.alive = port, [], True
        self.listener = socket.create_server(('127.0.0.1', 0))
        self.address = f'http://127.0.0.1:{self.listener.getsockname()[1]}/'
        threading.Thread(target=self._accept, daemon=True).start()

    def _accept(self):
        with contextlib.suppress(OSError):
            while True:
                near, _ = self.listener.accept()
                far = socket.create_connection(('127.0.0.1', self.port))
                pair = [near, far, True]
                self.pairs.append(pair)
                for one, other in ((near, far), (far, near)):
                    threading.Thread(target=self._pump, args=(one, other, pair),
                                     daemon=True).start()

    @staticmethod
    def _pump(one, other, pair):
        with contextlib.suppress(OSError):
            while (data := one.recv(65536)) and pair[2]:
                other.sendall(data)
            if pair[2]:
                other.shutdown(socket.SHUT_WR)

    def kill(self):
        """Let all connections of now die; new ones live."""
        for pair in self.pairs:
            pair[2] = False
            pair[1].close()

    def close(self):
        self.listener.close()
        self.kill()
        for near, *_ in self.pairs:
            near.close()


@pytest.mark.slow
def test_a_page_whose_connections_died_without_a_word_comes_back(station, browse):
    way = DeadEnd(int(station.page.address.split(':')[-1].strip('/')))
    with contextlib.closing(way):
        chrome = browse(way.address, 800, 600, token='only looking')
        chrome.wait(f"{STATE}.startsWith('live')")
        way.kill()
        chrome.wait(f"{STATE}.startsWith('FROZEN')")
        station.tables = make_rows(6, 4)
        chrome.wait(f"{STATE}.startsWith('live')")
        chrome.wait(f'{ALARMS}.length == 2')


@pytest.mark.slow
def test_alarms_of_others_ring_at_once_while_they_stand(browse):
    others, monitors = {'/uav1': make_rows(6, 0), '/uav2': make_rows(6, 0)}, {}

    def show(page):
        for name, tables in others.items():
            source, monitor = monitors.setdefault(name, (Source(), Monitor()))
            now = time.monotonic()
            monitor.take_summary(source.summary(now, keyframe=True, tables=tables), now)
            page.show(name, monitor.look(now), monitor.cloud)

    with Page('127.0.0.1', 0) as page:
        show(page)
        show(page)
        chrome = browse(page.address + '?vehicle=/uav1')
        chrome.wait("document.querySelectorAll('#fleet button').length == 2")
        chrome.run(SILENT_BELL)
        chrome.run('station.alarms.beep()')
        assert chrome.run('rung') == 0
        others['/uav2'] = make_rows(6, 1)
        show(page)
        show(page)
        chrome.wait('rung')  # before any timer
        others['/uav2'] = make_rows(6, 0)
        show(page)
        show(page)
        text = "document.querySelector('#fleet').textContent"
        chrome.wait(f"{text}.includes('1 not acknowledged') && !{text}.includes('1 critical')")
        chrome.run('rung = 0; station.alarms.beep()')
        assert chrome.run('rung') == 0
        assert '(+1 elsewhere)' in chrome.page.title()


@pytest.mark.slow
def test_everybody_can_use_it(station, browse):
    station.status = {'near': (WIRE,), 'heading': 0.5}
    chrome = browse(station.page.address, 390, 844, token='token to be shown', light=True)
    chrome.wait(f'{ALARMS}.length == 2')
    if AXE.exists():  # what the debugging protocol brings in is not the page's own
        chrome.run(AXE.read_text(encoding='utf-8') + ';0')
    problems = []
    for width, height in ((390, 844), (1024, 768), (1440, 900)):
        chrome.page.set_viewport_size({'width': width, 'height': height})
        chrome.page.click('#theme')
        assert chrome.run('document.documentElement.scrollWidth') <= width
        for selector in ('#picture', '#tables', '#alarms', '#state'):
            box = chrome.page.locator(selector).bounding_box()
            assert box['x'] >= 0
            assert box['x'] + box['width'] <= width
            assert box['y'] + box['height'] <= height + 1
        assert chrome.page.locator('#picture').bounding_box()['height'] > 0.2 * height
        if AXE.exists():
            problems += list_problems(chrome)
    if not AXE.exists():
        pytest.skip('axe-core is not installed: make axe (needs npm)')
    chrome.page.keyboard.press('2')
    chrome.page.click('#spans tr[data-span="1/0"] button')
    chrome.wait("document.querySelector('#profile svg') !== null")
    for key in ('2', '3', '4', '?'):
        chrome.page.keyboard.press(key)
        problems += list_problems(chrome)
    assert problems == []


@pytest.mark.slow
def test_severities_on_the_screen_look_alike_to_nobody(station, browse):
    chrome = browse(station.page.address, 1280, 800, token='only looking')
    chrome.page.click('#legend summary')
    found = {}
    for name in LOOKS:
        data = chrome.page.locator(f'#legend .shape[data-tone={name}]').screenshot()
        pixels = np.asarray(Image.open(io.BytesIO(data)).convert('RGB')).reshape(-1, 3)
        colors, counts = np.unique(pixels, axis=0, return_counts=True)
        order = counts.argsort()[::-1]
        fill = next(colors[k] for k in order if np.ptp(colors[k].astype(int)) > 40)
        found[name] = '#{:02x}{:02x}{:02x}'.format(*fill)
    for eye, (one, other) in itertools.product(EYES, itertools.combinations(found, 2)):
        distance = np.linalg.norm(see(found[one], eye) - see(found[other], eye))
        assert distance >= LEAST_DISTANCE, (eye, one, other)


@pytest.mark.slow
def test_a_replay_goes_where_its_time_line_is_pressed(browse):
    source, entries = Source(), []
    for k in range(60):
        entries.append(Entry(time=float(k), kind='summary', data=source.summary(
            float(k), keyframe=not k, tables=make_rows(6, int(k >= 30)))))
    replay = Replay(Tape(name='/plc_inspect', start=1.7e9, entries=tuple(entries)))
    ended = threading.Event()

    def run(page):
        while not ended.wait(0.1):
            for request in page.take_requests():
                replay.steer(request.time, request.playing, request.speed)
            replay.step(0.1)
            page.show('/plc_inspect', replay.look(), replay.cloud, replay)

    with Page('127.0.0.1', 0, replays=True) as page:
        page.show('/plc_inspect', replay.look(), replay.cloud, replay)
        thread = threading.Thread(target=run, args=(page,))
        thread.start()
        try:
            chrome = browse(page.address)
            assert chrome.run(ALARMS) == []
            assert chrome.run(STATE).startswith('replay: ')
            chrome.page.click('#play')  # it stands still
            chrome.page.click('#marks button')
            chrome.wait(f'{ALARMS}.length == 1')
            chrome.page.focus('#time')
            chrome.page.keyboard.press('Home')
            chrome.wait(f'{ALARMS}.length == 0')
            chrome.wait(
                "document.querySelector('#time-text').textContent.endsWith(', 0 of 59 s')"
            )
        finally:
            ended.set()
            thread.join()


def list_problems(chrome):
    """List what axe-core finds against WCAG 2.2 AA and its own good practice."""
    found = chrome.run('axe.run(document, {resultTypes: ["violations"]})')
    return [
        f'{item["id"]}: {node["html"][:120]} {node["failureSummary"][:300]}'
        for item in found['violations'] for node in item['nodes']
    ]
