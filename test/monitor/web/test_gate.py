# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Who may see the page: tokens, cookies, pages from elsewhere, and what is malformed."""

import contextlib
import http.client
import http.server
import socket
import threading

import pytest

from plc_inspect.errors import ConfigError
from plc_inspect.monitor.web.gate import Gate, is_loopback, read_head

TOKEN = 'correct horse'


class Inner(http.server.BaseHTTPRequestHandler):
    """The server behind the gate; it answers with what it was asked for."""

    protocol_version = 'HTTP/1.1'

    def do_GET(self):
        if self.headers.get('Upgrade'):
            self.connection.sendall(b'HTTP/1.1 101 Switching Protocols\r\n\r\n')
            while data := self.connection.recv(100):
                self.connection.sendall(data[::-1])
            self.close_connection = True
            return
        body = f'{self.path} {self.headers["Connection"]}'.encode()
        self.send_response(200)
        self.send_header('Content-Length', str(len(body)))
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, *_):
        """Say nothing."""


@pytest.fixture(scope='module')
def inner():
    """Run the server behind the gate and return its port."""
    server = http.server.ThreadingHTTPServer(('127.0.0.1', 0), Inner)
    thread = threading.Thread(target=server.serve_forever, daemon=True)
    thread.start()
    yield server.server_port
    server.shutdown()
    server.server_close()


@pytest.fixture(scope='module')
def open_gate(inner):
    """Return a gate without a token."""
    gate = Gate('127.0.0.1', 0, inner)
    yield gate
    gate.close()


@pytest.fixture(scope='module')
def gate(inner):
    """Return a gate with a token."""
    gate = Gate('127.0.0.1', 0, inner, TOKEN)
    yield gate
    gate.close()


def ask(gate, path='/', method='GET', body=None, **headers):
    """Return status, headers and text of an answer."""
    connection = http.client.HTTPConnection('127.0.0.1', gate.port, timeout=10)
    with contextlib.closing(connection):
        connection.request(method, path, body,
                           {name.replace('_', '-'): value for name, value in headers.items()})
        answer = connection.getresponse()
        return answer.status, dict(answer.headers), answer.read().decode()


def say(gate, data):
    """Send raw bytes and return all that comes back."""
    with socket.create_connection(('127.0.0.1', gate.port), timeout=10) as link:
        link.sendall(data)
        link.shutdown(socket.SHUT_WR)
        answer = b''
        while piece := link.recv(4096):
            answer += piece
        return answer


def test_on_this_machine_no_token_is_needed(open_gate):
    status, _, text = ask(open_gate, '/page?x=1')
    assert (status, text) == (200, '/page?x=1 close')


def test_a_token_opens_the_page_and_a_cookie_keeps_it_open(gate):
    status, _, text = ask(gate)
    assert status == 401
    assert 'type="password"' in text
    status, headers, _ = ask(gate, '/?token=correct+horse')
    assert (status, headers['Location']) == (303, '/')
    assert 'HttpOnly' in headers['Set-Cookie']
    assert TOKEN not in headers['Set-Cookie']
    cookie = headers['Set-Cookie'].split(';')[0]
    assert ask(gate, '/page', Cookie=cookie)[::2] == (200, '/page close')
    assert ask(gate, '/page', Cookie=f'other=1; {cookie}')[0] == 200


def test_the_form_takes_the_token(gate):
    status, headers, _ = ask(gate, '/login', 'POST', 'token=correct+horse')
    assert status == 303
    assert 'Set-Cookie' in headers
    status, headers, text = ask(gate, '/login', 'POST', 'token=wrong')
    assert status == 401
    assert 'Set-Cookie' not in headers
    assert 'Wrong token' in text


@pytest.mark.parametrize('cookie', [
    'plc_monitor=', 'plc_monitor=guess', f'plc_monitor={TOKEN}', 'plc_monitor="a;b', '=;;',
])
def test_without_the_right_cookie_nothing_passes(gate, cookie):
    assert ask(gate, '/page', Cookie=cookie)[0] == 401
    upgrade = {'Upgrade': 'websocket', 'Connection': 'Upgrade', 'Cookie': cookie}
    assert ask(gate, '/', **upgrade)[0] == 401


def test_a_web_socket_passes_both_ways(open_gate):
    host = f'127.0.0.1:{open_gate.port}'
    head = (f'GET / HTTP/1.1\r\nHost: {host}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n'
            f'Origin: http://{host}\r\n\r\n')
    with socket.create_connection(('127.0.0.1', open_gate.port), timeout=10) as link:
        link.sendall(head.encode())
        assert link.recv(100).startswith(b'HTTP/1.1 101')
        link.sendall(b'abc')
        assert link.recv(100) == b'cba'


def test_pages_from_elsewhere_are_refused(open_gate, gate):
    upgrade = {'Upgrade': 'websocket', 'Connection': 'Upgrade'}
    for origin in ('http://evil.example', f'http://127.0.0.1:{open_gate.port + 1}', 'null'):
        assert ask(open_gate, '/', Origin=origin, **upgrade)[0] == 403
    # A name that was made to point to this machine is not this machine's.
    assert ask(open_gate, '/', Host='evil.example')[0] == 403
    for host in ('localhost:1', '127.0.0.1', '[::1]:8080'):
        assert ask(open_gate, '/', Host=host)[0] == 200
    assert ask(gate, '/', Host='evil.example')[0] == 403


@pytest.mark.parametrize('data', [
    b'nonsense\r\n\r\n', b'GET /\r\n\r\n', b'GET / SPDY/3\r\n\r\n',
    b'GET / HTTP/1.1\r\nHost: 127.0.0.1\r\nHost: other\r\n\r\n',
    b'GET / HTTP/1.1\r\nHost : 127.0.0.1\r\n\r\n', b'GET / HTTP/1.1\r\nno colon\r\n\r\n',
])
def test_what_is_malformed_is_refused(open_gate, data):
    assert say(open_gate, data).startswith(b'HTTP/1.1 400')


def test_endless_heads_and_bodies_are_cut_off(open_gate, gate):
    # Cut off, which the sender may see as an answer that never came.
    with contextlib.suppress(OSError):
        assert say(open_gate, b'GET / HTTP/1.1\r\nX: ' + b'x' * 100_000) == b''
    head = b'POST /login HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Length: 99999999\r\n\r\n'
    assert say(gate, head).startswith(b'HTTP/1.1 400')
    assert ask(open_gate)[0] == 200


def test_others_want_a_token(inner):
    for host in ('0.0.0.0', '192.0.2.7', '::', 'some.name'):
        with pytest.raises(ConfigError, match=f'others can reach {host}: give a --token'):
            Gate(host, 0, inner)
    gate = Gate('0.0.0.0', 0, inner, TOKEN)
    assert ask(gate)[0] == 401
    gate.close()


def test_a_port_that_is_taken_is_told(open_gate, inner):
    with pytest.raises(ConfigError, match=f'cannot listen on 127.0.0.1 port {open_gate.port}'):
        Gate('127.0.0.1', open_gate.port, inner)


def test_what_is_this_machine():
    assert all(map(is_loopback, ('localhost', '127.0.0.1', '127.9.9.9', '::1', '[::1]')))
    assert not any(map(is_loopback, ('', '0.0.0.0', '::', '10.0.0.1', 'localhost.evil.example')))


def test_heads_are_read():
    request = read_head(b'GET /a?b HTTP/1.1\r\nHost: x\r\nUpgrade: WebSocket\r\n\r\n')
    assert (request.method, request.target, request.upgrade) == ('GET', '/a?b', True)
    assert request.headers == {'host': 'x', 'upgrade': 'WebSocket'}
