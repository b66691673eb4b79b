# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""A headless Chromium, driven over its debugging port."""

import base64
import itertools
import json
from pathlib import Path
import subprocess
import time
import urllib.request

from websockets.sync.client import connect

FLAGS = (
    '--headless', '--no-sandbox', '--use-angle=swiftshader', '--enable-unsafe-swiftshader',
    '--disable-background-networking', '--disable-dev-shm-usage', '--no-first-run',
    '--hide-scrollbars', '--remote-debugging-port=0', '--remote-allow-origins=*',
)


class Chrome:
    """One browser with one page."""

    def __init__(self, program, profile, width=1280, height=800, *, phone=False):
        self._process = subprocess.Popen(
            [program, *FLAGS, f'--user-data-dir={profile}', f'--window-size={width},{height}',
             'about:blank'],
            stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        )
        self._numbers = itertools.count(1)
        port = self._find_port(Path(profile) / 'DevToolsActivePort')
        with urllib.request.urlopen(f'http://127.0.0.1:{port}/json') as answer:
            targets = json.load(answer)
        address = next(t['webSocketDebuggerUrl'] for t in targets if t['type'] == 'page')
        self._socket = connect(address, max_size=None)
        self.call('Emulation.setDeviceMetricsOverride', width=width, height=height,
                  deviceScaleFactor=2 if phone else 1, mobile=phone)

    def _find_port(self, path):
        end = time.monotonic() + 30.0
        while time.monotonic() < end:
            if path.exists() and path.read_text().count('\n'):
                return int(path.read_text().splitlines()[0])
            time.sleep(0.05)
        raise AssertionError('the browser does not come up')

    def call(self, method, **parameters):
        """Send a command and return its result."""
        number = next(self._numbers)
        self._socket.send(json.dumps({'id': number, 'method': method, 'params': parameters}))
        while True:
            answer = json.loads(self._socket.recv(timeout=60.0))
            if answer.get('id') == number:
                assert 'error' not in answer, answer
                return answer['result']

    def open(self, address):
        """Go to a page."""
        self.call('Page.navigate', url=address)

    def run(self, expression):
        """Return what a JavaScript expression gives."""
        result = self.call('Runtime.evaluate', expression=expression, returnByValue=True)
        assert 'exceptionDetails' not in result, result
        return result['result'].get('value')

    def wait(self, expression, deadline=40.0):
        """Wait until an expression gives something true, and return it."""
        end = time.monotonic() + deadline
        while time.monotonic() < end:
            value = self.run(expression)
            if value:
                return value
            time.sleep(0.1)
        raise AssertionError(f'{expression} never came true')

    def click(self, x, y):
        """Press and release the mouse."""
        for kind in ('mouseMoved', 'mousePressed', 'mouseReleased'):
            self.call('Input.dispatchMouseEvent', type=kind, x=x, y=y, button='left',
                      clickCount=0 if kind == 'mouseMoved' else 1)
            time.sleep(0.1)

    def take_picture(self, path):
        """Write a PNG of what is seen."""
        data = self.call('Page.captureScreenshot', format='png')['data']
        Path(path).write_bytes(base64.b64decode(data))

    def close(self):
        """End the browser."""
        self._socket.close()
        self._process.terminate()
        try:
            self._process.wait(10.0)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
