# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""The page in a real browser, while node, player and monitor run as processes of their own."""

import contextlib
import json
import os
from pathlib import Path
import signal
import subprocess
import sys
import threading
import time

from chrome import Chrome
import numpy as np
from PIL import Image
import pytest
import rclpy
from rclpy.context import Context
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rig import isolate, take_domain, wait_for
from sensor_msgs.msg import PointCloud2
from stream_pieces import make_rows, Source

from plc_inspect.errors import ConfigError
from plc_inspect.messages.rows import read_rows
from plc_inspect.monitor.picture.model import Monitor
from plc_inspect.monitor.web.access import Role, Tokens
from plc_inspect.monitor.web.page import Page
from plc_inspect.offline.report.browser import find_browser
from plc_inspect.results import HazardKind
from plc_inspect.ros.graph.qos import RESULTS

ROOT = Path(__file__).parents[3]
TABLE = """(() => { const table = document.querySelector('#plc-%s');
return table && JSON.stringify([...table.querySelectorAll('tr')].slice(1)
.map(row => [...row.children].map(cell => cell.textContent.trim()))) })()"""
TAB = """(() => { const tab = [...document.querySelectorAll('[role=tab]')]
.find(tab => tab.innerText.trim() == '%s'), box = tab.getBoundingClientRect();
for (const kind of ['pointerdown', 'pointerup', 'click'])
tab.dispatchEvent(new PointerEvent(kind, {bubbles: true, pointerId: 1, isPrimary: true,
clientX: box.left + box.width / 2, clientY: box.top + box.height / 2})) })()"""
LINK = "document.querySelector('#plc-link')?.dataset.link"
WIDTH = """(() => { const box = document.querySelector('#plc-hazards').getBoundingClientRect();
return [box.left, box.right, document.documentElement.scrollWidth] })()"""
SHEETS = """[...document.querySelectorAll('style')]
.filter(sheet => sheet.textContent.includes('.plc')).length"""


@pytest.fixture(scope='module')
def program():
    """Find the browser, or say that there is none."""
    try:
        return find_browser()
    except ConfigError as error:
        pytest.skip(str(error))


class Flight:
    """Node, player and page as processes, and a subscriber to what the node publishes."""

    def __init__(self, folder):
        isolate()
        self.domain, self.folder = take_domain(), folder
        self.processes = []
        self.context = Context()
        rclpy.init(context=self.context, domain_id=self.domain)
        self.node = rclpy.create_node('reader', context=self.context)
        self.newest = {}
        for name in ('catenaries', 'hazards'):
            self.node.create_subscription(
                PointCloud2, f'/plc_inspect/{name}',
                lambda message, name=name: self.newest.update({name: message}), RESULTS,
            )
        self.executor = SingleThreadedExecutor(context=self.context)
        self.executor.add_node(self.node)
        self.thread = threading.Thread(target=self._spin, daemon=True)
        self.thread.start()

    def _spin(self):
        with contextlib.suppress(ExternalShutdownException):
            self.executor.spin()

    def start(self, module, *arguments, **options):
        environment = os.environ | {'ROS_DOMAIN_ID': str(self.domain)}
        process = subprocess.Popen([sys.executable, '-m', module, *map(str, arguments)], cwd=ROOT,
                                   env=environment, **options)
        self.processes.append(process)
        return process

    def start_node(self):
        return self.start('plc_inspect.ros.node.onboard', '--ros-args', '--log-level', 'warn',
                          '-p', f'output.directory:={self.folder / "out"}',
                          '-p', 'output.record:=false')

    def play(self, *arguments):
        return self.start('plc_inspect.ros.play', 'bags/demo', '--wait', '30', '--quiet',
                          *arguments)

    def rows(self, name):
        return read_rows(self.newest[name])

    def published(self):
        """Return what the node publishes as the page must show it."""
        hazards = {
            f'{HazardKind(row["kind"]).name.lower()} #{row["id"]}':
                [row['clearance'], row['required'], f'{row["line_id"]}/{row["span_id"]}']
            for row in self.rows('hazards')
        }
        spans = {
            f'{row["line_id"]}/{row["span_id"]}': [row['length'], row['sag'], row['rmse']]
            for row in self.rows('catenaries')
        }
        return hazards, spans

    def close(self):
        for process in self.processes:
            if process.poll() is None:
                process.send_signal(signal.SIGKILL)
            process.wait(20.0)
            if process.stdout:
                process.stdout.close()
        self.executor.shutdown()
        self.thread.join(10.0)
        self.node.destroy_node()
        rclpy.shutdown(context=self.context)


@pytest.fixture
def flight(tmp_path):
    """Return a graph for processes."""
    flight = Flight(tmp_path)
    yield flight
    flight.close()


@pytest.fixture
def browse(program, tmp_path):
    """Return a function that opens a page; the browsers are closed after the test."""
    browsers = []

    def browse(address, width=1280, height=800, token='', **options):
        chrome = Chrome(program, tmp_path / f'profile{len(browsers)}', width, height, **options)
        browsers.append(chrome)
        chrome.open(address)
        if token:
            chrome.wait("!!document.querySelector('input[name=token]')")
            chrome.run(f"document.querySelector('input[name=token]').value = '{token}'")
            chrome.run("document.querySelector('form').submit()")
        chrome.wait("!!document.querySelector('#plc-link')")
        return chrome

    yield browse
    for chrome in browsers:
        chrome.close()


def agree(shown, published):
    """Whether rows on the page hold the numbers that were published, as far as they show."""
    if {row[0].replace(' …', '') for row in shown} != set(published):
        return False
    for name, *texts in shown:
        for text, value in zip(texts, published[name.replace(' …', '')], strict=False):
            if isinstance(value, str):
                if text != value:
                    return False
            elif abs(float(text) - value) > 0.5 * 10.0 ** -len(text.partition('.')[2]) + 0.0015:
                return False
    return True


def open_tab(chrome, name):
    """Click a tab of the panel."""
    chrome.run(TAB % name)


def read_table(chrome, tab, name):
    """Return the rows of a table, None if its tab does not open soon."""
    open_tab(chrome, tab)
    end = time.monotonic() + 5.0
    while time.monotonic() < end:
        if text := chrome.run(TABLE % name):
            return json.loads(text)
        time.sleep(0.05)
    return None


def shows_what_is_published(chrome, flight):
    """Whether the page shows the hazards and spans that the node published last."""
    hazards, spans = flight.published()
    shown = read_table(chrome, 'Spans', 'spans'), read_table(chrome, 'Hazards', 'hazards')
    if None in shown or not spans:
        return False
    return agree(shown[0], spans) and agree(shown[1], hazards)


def test_it_shows_what_is_published_and_recovers(flight, browse, tmp_path):
    page = flight.start('plc_inspect.monitor.command', '--web', '--port', '0',
                        stdout=subprocess.PIPE, text=True)
    node = flight.start_node()
    player = flight.play()
    address = page.stdout.readline().split()[-1]
    assert address.startswith('http://127.0.0.1:')
    chrome = browse(address, 900, 500)
    chrome.wait(f"{LINK} == 'live'")
    wait_for(lambda: {'hazards', 'catenaries'} <= set(flight.newest), 'topics')
    wait_for(lambda: len(flight.rows('hazards')) and len(flight.rows('catenaries')) >= 6,
             'hazards', 60.0)
    assert chrome.run("document.querySelectorAll('canvas').length") >= 1

    player.kill()  # in mid-flight; another takes up, and later the node itself is killed
    player.wait()
    chrome.wait("document.querySelector('#plc-link').innerText.includes('nothing new')")
    wait_for(lambda: shows_what_is_published(chrome, flight), 'agreement at rest')
    chrome.take_picture(tmp_path / 'page.png')
    pixels = np.asarray(Image.open(tmp_path / 'page.png').convert('RGB')).astype(int)[:, :500]
    assert ((pixels.max(axis=2) - pixels.min(axis=2)) > 60).sum() > 300  # something in colour
    node.kill()
    node.wait()
    chrome.wait(f"{LINK} == 'lost'")
    assert json.loads(chrome.run(TABLE % 'hazards'))  # still there, and called old
    assert 'all of this is old' in chrome.run("document.querySelector('#plc-link').innerText")

    flight.newest.clear()
    flight.start_node()
    chrome.wait(f"{LINK} == 'live'")
    assert json.loads(chrome.run(TABLE % 'hazards')) == []
    open_tab(chrome, 'Health')
    chrome.wait("document.querySelector('#plc-events').innerText.includes('started anew')")
    flight.play('--start', '1')
    wait_for(lambda: 'catenaries' in flight.newest and len(flight.rows('catenaries')), 'spans',
             60.0)
    wait_for(lambda: shows_what_is_published(chrome, flight), 'agreement again')


def test_a_phone_a_profile_a_tap_and_a_frozen_page(browse):
    monitor, source = Monitor(), Source()
    began, ended = time.monotonic(), threading.Event()
    tokens = Tokens({Role.ACKNOWLEDGE: 'token to be shown'})
    with Page('127.0.0.1', 0, monitor.cloud, tokens) as page:
        def run():
            while not ended.is_set():
                now = time.monotonic()
                monitor.take_summary(source.summary(
                    now - began, keyframe=not source.writer._sequence, tables=make_rows(6, 3)
                ), now)
                page.show(monitor.look(now))
                ended.wait(0.3)

        thread = threading.Thread(target=run)
        thread.start()
        try:
            phone = browse(page.address, 390, 844, phone=True, token='token to be shown')
            phone.wait(TABLE % 'hazards' + ' != "[]"')
            left, right, width = phone.run(WIDTH)
            assert left >= 0.0
            assert right <= 390.0
            assert right - left > 300.0
            assert width <= 390
            # A hazard is chosen, the camera goes there, and a tap on it chooses it again.
            panel = next(iter(page._panels.values()))
            hazard = monitor.look(time.monotonic()).hazards[1]
            panel._hazard.value = f'#{hazard.hazard_id} {hazard.kind}, line 1 span 0'
            detail = "document.querySelector('#plc-hazard')?.dataset.hazard"
            phone.wait(f"{detail} == '{hazard.hazard_id}'")
            panel._go_to_hazard()
            open_tab(phone, 'Spans')
            panel._span.value = '1/0'
            panel._redraw_profile()
            phone.wait("document.querySelector('#plc-span')?.dataset.span == '1/0'")
            assert phone.run("document.querySelectorAll('svg[role=img] circle').length") == 1
            panel.choose_hazard(0)
            phone.wait("document.querySelector('#plc-span')?.dataset.span == '0/0'")
            assert phone.run(SHEETS) == 1
            frozen = "document.querySelector('.frozen').getBoundingClientRect().height"
            assert phone.run(frozen) == 0
        finally:
            ended.set()
            thread.join()
        phone.wait(f'{frozen} > 10')


def test_a_hazard_is_tapped_in_the_picture(browse):
    monitor, source = Monitor(), Source()
    now = time.monotonic()
    monitor.take_summary(source.summary(1.0, keyframe=True, tables=make_rows(6, 1)), now)
    with Page('127.0.0.1', 0, monitor.cloud) as page:
        page.show(monitor.look(now))
        chrome = browse(page.address, 1280, 600)
        panel = wait_for(lambda: next(iter(page._panels.values()), None), 'panel')
        hazard = monitor.look(now).hazards[0]
        panel._hazard.value = f'#0 {hazard.kind}, line {hazard.line_id} span {hazard.span_id}'
        panel._go_to_hazard()
        detail = "document.querySelector('#plc-hazard')?.dataset.hazard"
        chrome.wait(f"{detail} == '0'")
        panel._hazard.value = 'none'
        page.show(monitor.look(now))
        chrome.wait(f'!{detail}')
        for _ in range(10):
            time.sleep(0.5)
            chrome.click(640, 300)  # where the camera looks
            if chrome.run(detail) == '0':
                return
        raise AssertionError('the tap chose nothing')
