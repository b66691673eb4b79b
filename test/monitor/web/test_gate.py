# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Who may see the page: what the OWASP guides list, tried on the real gate."""

import asyncio
import contextlib
import http.client
import json
import os
import socket
import ssl
import time

from aiohttp import ClientSession
import numpy as np
import pytest

from plc_inspect.errors import ConfigError
from plc_inspect.monitor.web import access
from plc_inspect.monitor.web import gate as gate_module
from plc_inspect.monitor.web.access import check_tokens, Penalties, read_tokens, Role, Tokens
from plc_inspect.monitor.web.cells import BlockPoints
from plc_inspect.monitor.web.gate import Gate, is_loopback
from plc_inspect.monitor.web.site import Site
from plc_inspect.monitor.web.template import FOLDER, list_files
from plc_inspect.security.authority import issue, make_authority
from plc_inspect.security.strangers import MOST_STRANGERS

TOKENS = Tokens({Role.VIEW: 'only looking', Role.ACKNOWLEDGE: 'correct horse'})


WHO = '{"vehicle": "/plc_inspect", "numbers": [1, 2], "who": "crew"}'
UPGRADE = {
    'Upgrade': 'websocket', 'Connection': 'Upgrade', 'Sec-WebSocket-Version': '13',
    'Sec-WebSocket-Key': 'dGhlIHNhbXBsZSBub25jZQ==',
}


@pytest.fixture
def site():
    """Return a page of one vehicle."""
    site = Site(lambda vehicle, key: {'title': f'{vehicle} {key}'} if key == (0, 1) else None)
    site.find_hub('/plc_inspect').put({'state': {'text': 'all is well'}})
    return site


@pytest.fixture(scope='module')
def open_gate():
    """Return a gate without tokens."""
    gate = Gate('127.0.0.1', 0, Site(lambda vehicle, key: None))
    yield gate
    gate.close()


@pytest.fixture
def gate(site):
    """Return a gate with tokens."""
    gate = Gate('127.0.0.1', 0, site, TOKENS)
    yield gate
    gate.close()


def ask(gate, path='/', method='GET', body=None, *, peer='127.0.0.1', **headers):
    """Return status, headers and text of an answer to somebody with an address."""
    connection = http.client.HTTPConnection(
        '127.0.0.1', gate.port, timeout=10, source_address=(peer, 0)
    )
    with contextlib.closing(connection):
        connection.request(method, path, body,
                           {name.replace('_', '-'): value for name, value in headers.items()})
        answer = connection.getresponse()
        return answer.status, dict(answer.headers), answer.read().decode()


def log_in(gate, token, **headers):
    """Return status and cookie of a try."""
    status, found, _ = ask(gate, '/login', 'POST', f'token={token.replace(" ", "+")}',
                           Content_Type='application/x-www-form-urlencoded', **headers)
    return status, found.get('Set-Cookie', '').split(';')[0]


def say(gate, data):
    """Send raw bytes and return all that comes back."""
    with socket.create_connection(('127.0.0.1', gate.port), timeout=10) as link:
        link.sendall(data)
        link.shutdown(socket.SHUT_WR)
        answer = b''
        with contextlib.suppress(ConnectionError):
            while piece := link.recv(4096):
                answer += piece
        return answer


def test_on_this_machine_no_token_is_needed(open_gate):
    status, headers, text = ask(open_gate, '/?x=1', Cookie='own=1')
    assert status == 200
    assert text.startswith('<!DOCTYPE html>')
    assert 'Set-Cookie' not in headers


def test_a_token_opens_the_page_and_a_cookie_keeps_it_open(gate):
    status, _, text = ask(gate)
    assert status == 401
    assert 'type="password"' in text
    status, headers, _ = ask(gate, '/login', 'POST', 'token=correct+horse',
                             Content_Type='application/x-www-form-urlencoded')
    assert (status, headers['Location']) == (303, '/')
    cookie = headers['Set-Cookie']
    assert 'HttpOnly' in cookie
    assert 'SameSite=Strict' in cookie
    assert 'horse' not in cookie
    assert ask(gate, '/', Cookie=f'other=1; {cookie.split(";")[0]}')[0] == 200


def test_a_header_opens_the_page_and_an_address_never_does(gate):
    assert ask(gate, '/', Authorization='Bearer correct horse')[0] == 200
    assert ask(gate, '/', Authorization='Bearer only looking')[0] == 200
    for path in ('/?token=correct+horse', '/login?token=correct+horse', '/token/correct+horse'):
        assert ask(gate, path)[0] == 401  # a referrer or a log would keep it


@pytest.mark.parametrize('cookie', [
    'plc_monitor=', 'plc_monitor=guess', 'plc_monitor=correct horse', 'plc_monitor="a;b', '=;;',
])
def test_without_the_right_cookie_nothing_passes(gate, cookie):
    for path in ('/', '/main.js', '/profile?span=0/1', '/nothing'):
        assert ask(gate, path, Cookie=cookie)[0] == 401
    assert ask(gate, '/live', Cookie=cookie, **UPGRADE)[0] == 401


def test_who_may_view_may_not_acknowledge(gate, site):
    for token, status in (('only looking', 403), ('correct horse', 204)):
        _, cookie = log_in(gate, token)
        assert ask(gate, '/', Cookie=cookie)[0] == 200
        assert ask(gate, '/acknowledge', 'POST', WHO, Cookie=cookie)[0] == status
    assert ask(gate, '/acknowledge', 'POST', WHO)[0] == 401
    (request,) = site.requests
    assert (request.vehicle, request.numbers, request.who) == ('/plc_inspect', (1, 2), 'crew')


@pytest.mark.parametrize(('body', 'status'), [
    ('', 400), ('[]', 400), ('{"vehicle": "/plc_inspect"}', 400),
    (WHO.replace('crew', ' '), 400), (WHO.replace('crew', 'A' * 41), 400),
    (WHO.replace('[1, 2]', '["1"]'), 400), (WHO.replace('[1, 2]', '1'), 400),
    (WHO.replace('"crew"', '7'), 400), (WHO.replace('"/plc_inspect"', '["x"]'), 400),
    (WHO.replace('"/plc_inspect"', '{}'), 400), (WHO.replace('/plc', '/other'), 404),
])
def test_who_acknowledges_says_what_and_who(gate, site, body, status):
    _, cookie = log_in(gate, 'correct horse')
    assert ask(gate, '/acknowledge', 'POST', body, Cookie=cookie)[0] == status
    assert not site.requests


def test_a_body_in_an_unknown_charset_is_refused(gate, site):
    _, cookie = log_in(gate, 'correct horse')
    head = {'Cookie': cookie, 'Content_Type': 'application/json; charset=none'}
    assert ask(gate, '/acknowledge', 'POST', WHO, **head)[0] == 400
    assert not site.requests


def test_names_hold_no_control_characters(gate, site):
    _, cookie = log_in(gate, 'correct horse')
    body = WHO.replace('crew', r'A\u001b[2Jb')
    assert ask(gate, '/acknowledge', 'POST', body, Cookie=cookie)[0] == 204
    assert '\x1b' not in site.requests[0].who


def test_forms_of_other_pages_do_nothing(gate, site):
    _, cookie = log_in(gate, 'correct horse')
    host = f'127.0.0.1:{gate.port}'
    for origin in ('http://evil.example', 'null', f'https://{host}', f'http://127.0.0.1:{1}'):
        assert ask(gate, '/acknowledge', 'POST', WHO, Cookie=cookie, Origin=origin)[0] == 403
        assert log_in(gate, 'correct horse', Origin=origin)[0] == 403
    far = {'Cookie': cookie, 'Sec_Fetch_Site': 'cross-site'}
    assert ask(gate, '/acknowledge', 'POST', WHO, **far)[0] == 403
    assert ask(gate, '/acknowledge', 'GET', Cookie=cookie)[0] == 404
    assert not site.requests
    own = {'Cookie': cookie, 'Origin': f'http://{host}'}
    assert ask(gate, '/acknowledge', 'POST', WHO, **own)[0] == 204


def test_foreign_hosts_and_origins_are_refused(open_gate, gate):
    for origin in ('http://evil.example', f'http://127.0.0.1:{open_gate.port + 1}', 'null'):
        assert ask(open_gate, '/live', Origin=origin, **UPGRADE)[0] == 403
    # A name that was made to point to this machine is not this machine's.
    assert ask(open_gate, '/', Host='evil.example')[0] == 403
    for host in ('localhost:1', '127.0.0.1', '[::1]:8080'):
        assert ask(open_gate, '/', Host=host)[0] == 200
    assert ask(gate, '/', Host='evil.example')[0] == 403
    for host in ('[::1', '[', '::1]', '[nobody]'):
        assert ask(open_gate, '/', Host=host)[0] == 400
        assert ask(gate, '/', Host=host)[0] == 400


@pytest.mark.parametrize('path', [
    '/../web/gate.py', '/a/../../web/gate.py', '/%2e%2e/web/gate.py', '/..%2fweb/gate.py',
    '/vendor/%2e%2e/%2e%2e/web/gate.py', '//etc/passwd', '/index.html', '/door.html',
])
def test_nothing_above_the_page_is_reached(open_gate, path):
    link = http.client.HTTPConnection('127.0.0.1', open_gate.port, timeout=10)
    link.putrequest('GET', path, skip_host=False)
    link.endheaders()
    answer = link.getresponse()
    answer.read()
    link.close()
    assert answer.status == 404


def test_every_answer_says_what_a_browser_may_do(gate):
    _, cookie = log_in(gate, 'correct horse')
    nonces = set()
    for status, found, _ in (
        ask(gate), ask(gate, Cookie=cookie), ask(gate, Host='evil.example'),
        ask(gate, '/x', 'DELETE', Cookie=cookie), ask(gate, '/login', 'POST', 'x' * 9000),
    ):
        assert status in (200, 401, 403, 405, 413)
        policy = dict(
            item.strip().split(' ', 1) for item in found['Content-Security-Policy'].split(';')
        )
        assert policy['default-src'] == policy['frame-ancestors'] == policy['base-uri'] == "'none'"
        assert 'unsafe' not in policy['script-src']
        assert policy['form-action'] == "'self'"
        nonces.add(policy['script-src'])
        assert found['X-Frame-Options'] == 'DENY'
        assert found['X-Content-Type-Options'] == 'nosniff'
        assert found['Referrer-Policy'] == 'same-origin'
        assert found['Cache-Control'] == 'no-store'
        assert found['Server'] == 'plc_monitor'
    assert len(nonces) == 5


def test_who_guesses_waits_and_nobody_else(monkeypatch):
    clock = [0.0]
    monkeypatch.setattr(access.time, 'monotonic', lambda: clock[0])
    penalties, waits = Penalties(), []
    for _ in range(8):
        penalties.note_wrong('10.0.0.9')
        waits.append(penalties.wait_of('10.0.0.9'))
        assert penalties.wait_of('10.0.0.1') == 0.0
        clock[0] += waits[-1]
    assert waits == [0.5, 1.0, 2.0, 4.0, 5.0, 5.0, 5.0, 5.0]
    assert penalties.wait_of('10.0.0.9') == 0.0
    for number in range(access.MOST_PEERS + 10):
        penalties.note_wrong(str(number))
    assert len(penalties._peers) == access.MOST_PEERS


def test_a_network_of_addresses_is_one_guesser():
    penalties = Penalties()
    penalties.note_wrong('2001:db8::1')
    for peer in ('2001:db8::1', '2001:db8::ffff:2', '2001:db8:0:0:9::1'):
        assert penalties.wait_of(peer) > 0.0
    for peer in ('2001:db8:0:1::1', '10.0.0.1', '', 'fe80::1%eth0'):
        assert penalties.wait_of(peer) == 0.0
    penalties.note_wrong('::ffff:10.0.0.1')
    assert penalties.wait_of('10.0.0.1') > 0.0
    penalties.note_right('2001:db8::5')
    assert penalties.wait_of('2001:db8::1') == 0.0


def test_the_right_token_of_another_address_is_not_delayed(gate):
    """A hundred wrong ones while somebody else logs in, again and again."""
    statuses = [log_in(gate, f'wrong token {k}', peer='127.0.0.2')[0] for k in range(100)]
    assert set(statuses) == {401, 429}
    delays = []
    for k in range(10):
        log_in(gate, f'wrong token {k}', peer='127.0.0.2')
        begin = time.monotonic()
        assert log_in(gate, 'correct horse', peer='127.0.0.3')[0] == 303
        assert ask(gate, peer='127.0.0.3', Authorization='Bearer only looking')[0] == 200
        delays.append(time.monotonic() - begin)
    assert sorted(delays)[len(delays) // 2] < access.MOST_PENALTY / 2


def test_no_address_ever_holds_a_token(gate):
    """Nothing that a referrer, a history or a log could keep; and no referrer goes elsewhere."""
    status, headers, text = ask(gate, '/?token=correct+horse&next=/')
    assert (status, headers['Referrer-Policy']) == (401, 'same-origin')
    form = text[text.index('<form'):text.index('</form>')]
    assert 'method="post"' in form.lower()
    assert 'horse' not in text
    _, headers, _ = ask(gate, '/login', 'POST', 'token=correct+horse',
                        Content_Type='application/x-www-form-urlencoded')
    assert headers['Location'] == '/'
    _, cookie = log_in(gate, 'correct horse')
    _, _, text = ask(gate, Cookie=cookie)
    assert 'horse' not in text
    assert cookie.split('=')[1] not in text
    assert not [path for path, (_, data) in list_files().items()
                if b'token=' in data and 'vendor' not in path]


def test_brute_force_is_slow_and_a_session_does_not_notice(gate):
    _, cookie = log_in(gate, 'correct horse')
    answers = [log_in(gate, f'wrong token {k}')[0] for k in range(100)]
    assert answers[0] == 401
    assert answers.count(429) >= 95
    assert ask(gate, '/', Cookie=cookie)[0] == 200
    assert log_in(gate, 'correct horse')[0] == 429  # not even the right one is looked at
    started = time.monotonic()
    while log_in(gate, 'correct horse')[0] != 303:
        assert time.monotonic() - started < access.MOST_PENALTY + 1.0
        time.sleep(0.1)


@pytest.mark.parametrize('data', [
    b'nonsense\r\n\r\n', b'GET /\r\n\r\n', b'GET / SPDY/3\r\n\r\n',
    b'GET / HTTP/1.1\r\nHost : 127.0.0.1\r\n\r\n', b'GET / HTTP/1.1\r\nno colon\r\n\r\n',
    b'GET / HTTP/1.1\r\nX: ' + b'x' * 100_000,
    b'POST /login HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Length: 5\r\n'
    b'Transfer-Encoding: chunked\r\n\r\n0\r\n\r\n',
])
def test_what_is_malformed_is_refused(open_gate, data):
    answer = say(open_gate, data)
    assert not answer or answer.split()[1] in (b'400', b'403')
    assert ask(open_gate)[0] == 200


@pytest.mark.parametrize('header', [
    b'Authorization: Bearer \xff\xfe', b'Cookie: plc_monitor=\xff',
])
def test_headers_of_other_bytes_are_no_token(gate, header):
    with socket.create_connection(('127.0.0.1', gate.port), timeout=10) as link:
        link.sendall(b'GET / HTTP/1.1\r\nHost: localhost\r\n' + header + b'\r\n\r\n')
        answer = link.recv(4096)
    assert answer.split()[1] == b'401'
    assert b'Content-Security-Policy' in answer
    wrong = header.startswith(b'Authorization')
    assert ask(gate, Authorization='Bearer correct horse')[0] == (429 if wrong else 200)


def test_who_says_nothing_is_cut_off(site, monkeypatch):
    monkeypatch.setattr(gate_module, 'TIMEOUT', 0.5)
    monkeypatch.setattr(gate_module, 'MOST_CONNECTIONS', 30)
    gate = Gate('127.0.0.1', 0, site)
    try:
        slow = [socket.create_connection(('127.0.0.1', gate.port), 10) for _ in range(20)]
        for link in slow:
            link.sendall(b'GET / HTTP/1.1\r\nHo')
        assert ask(gate)[0] == 200
        started = time.monotonic()
        for link in slow:
            with contextlib.suppress(ConnectionError):
                assert link.recv(1) == b''
            link.close()
        assert time.monotonic() - started < 3.0
    finally:
        gate.close()


@pytest.mark.parametrize('secure', [False, True])
@pytest.mark.parametrize('data', [b'', b'GET / HTTP/1.1\r\nHost: localhost\r\n\r\n'])
def test_strangers_keep_nobody_out(site, tmp_path, secure, data):
    own = issue(make_authority('a', 10), 'b', 5, ('127.0.0.1',))
    (tmp_path / 'crt').write_bytes(own.pem)
    (tmp_path / 'key').write_bytes(own.key_pem)
    tls = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    tls.load_cert_chain(tmp_path / 'crt', tmp_path / 'key')
    gate = Gate('127.0.0.1', 0, site, TOKENS, tls=tls if secure else None)
    num_before, links = len(os.listdir('/proc/self/fd')), []
    with contextlib.closing(gate), contextlib.ExitStack() as stack:
        for _ in range(250):
            links.append(stack.enter_context(socket.create_connection(
                ('127.0.0.1', gate.port), source_address=('127.0.0.2', 0)
            )))
            with contextlib.suppress(ConnectionError):
                links[-1].sendall(data)
        with socket.create_connection(('127.0.0.1', gate.port), 10) as link:
            time.sleep(1.0)  # over a slow link
            if secure:
                lax = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
                lax.check_hostname, lax.verify_mode = False, ssl.CERT_NONE
                link = stack.enter_context(lax.wrap_socket(link))
            link.sendall(b'GET / HTTP/1.1\r\nHost: localhost\r\n'
                         b'Authorization: Bearer only looking\r\n\r\n')
            assert link.recv(100).startswith(b'HTTP/1.1 200')
            num_open = len(os.listdir('/proc/self/fd')) - num_before - len(links)
            assert num_open <= MOST_STRANGERS + 10


def test_strangers_do_not_outlive_the_page(site):
    gate = Gate('127.0.0.1', 0, site, TOKENS)
    with socket.create_connection(('127.0.0.1', gate.port), 10) as link:
        end = time.monotonic() + 10.0
        while not gate._strangers:
            assert time.monotonic() < end
            time.sleep(0.01)
        gate.close()
        assert link.recv(1) == b''
    assert asyncio.all_tasks(gate._loop) == set()


def test_others_want_a_token(site):
    for host in ('0.0.0.0', '192.0.2.7', '::', 'some.name'):
        with pytest.raises(ConfigError, match=f'others can reach {host}: give tokens'):
            Gate(host, 0, site)
    gate = Gate('0.0.0.0', 0, site, TOKENS)
    assert ask(gate)[0] == 401
    gate.close()


def test_a_port_that_is_taken_is_told(open_gate, site, monkeypatch):
    made = []
    begin = gate_module.web.AppRunner.setup

    async def note(runner):
        made.append(runner)
        await begin(runner)

    monkeypatch.setattr(gate_module.web.AppRunner, 'setup', note)
    with pytest.raises(ConfigError, match=f'cannot listen on 127.0.0.1 port {open_gate.port}'):
        Gate('127.0.0.1', open_gate.port, site)
    (runner,) = made
    assert runner.server is None  # nothing is left open


def test_what_is_this_machine():
    assert all(map(is_loopback, ('localhost', '127.0.0.1', '127.9.9.9', '::1', '[::1]')))
    assert not any(map(is_loopback, ('', '0.0.0.0', '::', '10.0.0.1', 'localhost.evil.example')))


def test_https_has_the_certificate_of_the_fleet(site, tmp_path):
    authority = make_authority('root', 10)
    own = issue(authority, 'ground', 5, ('localhost', '127.0.0.1'))
    (tmp_path / 'crt').write_bytes(own.pem)
    (tmp_path / 'key').write_bytes(own.key_pem)
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.load_cert_chain(tmp_path / 'crt', tmp_path / 'key')
    gate = Gate('127.0.0.1', 0, site, TOKENS, tls=context)
    try:
        trusting = ssl.create_default_context(cadata=authority.pem.decode())
        link = http.client.HTTPSConnection('127.0.0.1', gate.port, timeout=10, context=trusting)
        link.request('POST', '/login', 'token=correct+horse',
                     {'Content-Type': 'application/x-www-form-urlencoded'})
        answer = link.getresponse()
        answer.read()
        link.close()
        assert answer.status == 303
        assert 'Secure' in answer.headers['Set-Cookie']
        assert 'max-age' in answer.headers['Strict-Transport-Security']
        stranger = http.client.HTTPSConnection('127.0.0.1', gate.port, timeout=10)
        with pytest.raises(ssl.SSLCertVerificationError):
            stranger.request('GET', '/')
    finally:
        gate.close()


@pytest.mark.parametrize(('text', 'mode', 'problem'), [
    ('view a token\n', 0o644, 'may be read by others'), ('', 0o600, 'holds no token'),
    ('look abcdefgh', 0o600, 'lines are'), ('view short', 0o600, 'at least 8'),
    ('view same word\nacknowledge same word', 0o600, 'the same token'),
])
def test_files_of_tokens_are_looked_at(tmp_path, text, mode, problem):
    path = tmp_path / 'tokens'
    path.write_text(text)
    path.chmod(mode)
    with pytest.raises(ConfigError, match=problem):
        read_tokens(path)


def test_tokens_are_read(tmp_path):
    path = tmp_path / 'tokens'
    path.write_text('view only looking\n\nacknowledge  correct horse\n')
    path.chmod(0o600)
    assert read_tokens(path) == TOKENS
    assert check_tokens({}) == Tokens({})


@pytest.mark.parametrize(('body', 'status'), [
    ('{"time": 12.5}', 204), ('{"playing": false, "speed": 4}', 204), ('{"time": -1}', 400),
    ('{"time": "1"}', 400), ('{"time": NaN}', 400), ('{"playing": 7}', 400), ('[]', 400),
    ('', 400),
])
def test_a_replay_is_steered_and_acknowledges_nothing(body, status):
    site = Site(lambda vehicle, key: None, replays=True)
    site.find_hub('/plc_inspect')
    gate = Gate('127.0.0.1', 0, site, TOKENS)
    try:
        head = {'Authorization': 'Bearer correct horse'}
        assert ask(gate, '/time', 'POST', body, **head)[0] == status
        assert len(site.requests) == (status == 204)
        assert ask(gate, '/acknowledge', 'POST', WHO, **head)[0] == 405
        assert ask(gate, '/time', 'POST', body, Authorization='Bearer only looking')[0] == 403
    finally:
        gate.close()


def make_block(number):
    """Return a block of one point."""
    return BlockPoints((0, number), (0.0, 0.0, 0.0), 0.5, np.zeros((1, 3), np.int16),
                       np.full((1, 3), number, np.uint8))


def test_a_browser_gets_what_is_known_and_then_what_changes(gate, site):
    hub = site.find_hub('/plc_inspect')
    hub.put({'alarms': []}, {'spans': [('0/1', 7)]}, [make_block(1), make_block(2)])

    async def listen():
        headers = {'Authorization': 'Bearer only looking'}
        address = f'http://127.0.0.1:{gate.port}/live'
        async with ClientSession(headers=headers) as session, session.ws_connect(address) as link:
            async def take(count):
                found = []
                while len(found) < count:
                    found.append((await link.receive(10.0)).data)
                    await link.send_str('.')
                return found

            found = await take(7)
            hub.put({'state': {'text': 'all is well'}, 'alarms': [1]}, {'spans': [('0/1', 8)]},
                    [make_block(2)])
            found += await take(3)
            with pytest.raises(TimeoutError):
                await link.receive(0.3)
            return found

    greeting, *parts, row, block, other, changed, new_row, news = asyncio.run(listen())
    own = json.loads(greeting)['value']
    assert isinstance(own.pop('life'), int)
    assert own == {'vehicle': '/plc_inspect', 'acknowledges': False}
    assert [json.loads(part)['part'] for part in parts] == ['state', 'alarms', 'spans-keys']
    assert json.loads(row) == {'part': 'spans', 'value': {'rows': [['0/1', 7]]}}
    assert json.loads(new_row) == {'part': 'spans', 'value': {'rows': [['0/1', 8]]}}
    assert [data[-3] for data in (block, other, news)] == [1, 2, 2]
    changed = json.loads(changed)  # not what is as before
    assert changed.pop('version') > json.loads(parts[1])['version']
    assert changed == {'part': 'alarms', 'value': [1]}


def test_alarms_come_over_a_connection_of_their_own_too(gate, site):
    hub = site.find_hub('/plc_inspect')
    hub.put({'alarms': [], 'state': {}}, {'spans': [('0/1', 7)]}, [make_block(1)])

    async def listen():
        headers = {'Authorization': 'Bearer only looking'}
        address = f'http://127.0.0.1:{gate.port}/live'
        async with ClientSession(headers=headers) as session, \
                session.ws_connect(address) as all_of_it, \
                session.ws_connect(f'{address}?alarms=1') as alarms:
            found = [json.loads((await alarms.receive(10.0)).data) for _ in range(2)]
            hub.put({'state': {'text': 'changed'}})
            with pytest.raises(TimeoutError):
                await alarms.receive(0.3)
            hub.put({'alarms': [1]})
            found.append(json.loads((await alarms.receive(10.0)).data))
            while True:
                other = (await all_of_it.receive(10.0)).data
                if isinstance(other, str) and json.loads(other) == found[-1]:
                    return found

    greeting, first, news = asyncio.run(listen())
    assert greeting['part'] == 'me'
    assert (first['part'], first['value']) == ('alarms', [])
    assert (news['part'], news['value']) == ('alarms', [1])
    assert news['version'] > first['version']


def test_a_browser_that_asks_for_another_vehicle_gets_nothing(gate):
    head = {'Authorization': 'Bearer only looking'}
    assert ask(gate, '/live?vehicle=/other', **head, **UPGRADE)[0] == 404


def test_the_side_view_of_a_span_is_asked_for(gate):
    head = {'Authorization': 'Bearer only looking'}
    for span, status in (('0/1', 200), ('0/2', 404), ('x', 400), ('1/2/3', 400), ('', 400)):
        assert ask(gate, f'/profile?vehicle=/a&span={span}', **head)[0] == status


def test_the_program_of_the_page_is_served_whole(open_gate):
    for path in ('/main.js', '/style.css', '/vendor/three/three.module.min.js',
                 '/vendor/three/LICENSE'):
        status, headers, text = ask(open_gate, path)
        assert status == 200
        assert text == (FOLDER / path[1:]).read_text(encoding='utf-8')
        assert headers['X-Content-Type-Options'] == 'nosniff'
    assert ask(open_gate, '/main.py')[0] == 404


def test_no_token_stands_in_the_process_list(gate):
    with open(f'/proc/{os.getpid()}/cmdline', 'rb') as file:
        assert b'correct horse' not in file.read()
