# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Node, player and page as processes of their own, and what the page shows."""

import contextlib
import os
from pathlib import Path
import signal
import subprocess
import sys
import threading

import rclpy
from rclpy.context import Context
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rig import isolate, take_domain
from sensor_msgs.msg import PointCloud2

from plc_inspect.messages.rows import read_rows
from plc_inspect.ros.graph.qos import RESULTS

ROOT = Path(__file__).parents[3]
HAZARDS = """[...document.querySelectorAll('#hazards tr')].map(row =>
[row.dataset.hazard, row.children[2].textContent, row.children[3].textContent])"""
SPANS = """[...document.querySelectorAll('#spans tr')].map(row =>
[row.dataset.span, row.children[1].textContent, row.children[2].textContent])"""
TONE = "document.querySelector('#state').dataset.tone"
STATE = "document.querySelector('#state-text').textContent"
ALARMS = """[...document.querySelectorAll('#alarm-list li')].map(item =>
[item.dataset.state, item.querySelector('.what').textContent])"""


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
        self.listen()
        self.executor = SingleThreadedExecutor(context=self.context)
        self.executor.add_node(self.node)
        self.thread = threading.Thread(target=self._spin, daemon=True)
        self.thread.start()

    def listen(self, space=''):
        """Keep the newest results of the node in a namespace."""
        for name in ('catenaries', 'hazards'):
            self.node.create_subscription(
                PointCloud2, f'{space}/plc_inspect/{name}',
                lambda message, key=space + name: self.newest.update({key: message}), RESULTS,
            )

    def _spin(self):
        with contextlib.suppress(ExternalShutdownException):
            self.executor.spin()

    def start(self, module, *arguments, **options):
        environment = os.environ | {'ROS_DOMAIN_ID': str(self.domain)}
        process = subprocess.Popen([sys.executable, '-m', module, *map(str, arguments)], cwd=ROOT,
                                   env=environment, **options)
        self.processes.append(process)
        return process

    def start_node(self, space='', *words):
        return self.start('plc_inspect.ros.node.onboard', '--ros-args', '--log-level', 'warn',
                          '-p', f'output.directory:={self.folder}/out{space}',
                          '-p', 'output.record:=false', *words, *_put_into(space))

    def start_page(self, *arguments):
        """Start the monitor, and return its process and address."""
        page = self.start('plc_inspect.monitor.command', '--web', '--port', '0', *arguments,
                          stdout=subprocess.PIPE, text=True)
        return page, page.stdout.readline().split()[-1]

    def play(self, *arguments, space='', ros=()):
        return self.start('plc_inspect.ros.play', 'bags/demo', '--wait', '30', '--quiet',
                          *arguments, '--ros-args', *_put_into(space), *ros)

    def rows(self, name, space=''):
        return read_rows(self.newest[space + name])

    def published(self, space=''):
        """Return what the node publishes as the page must show it."""
        hazards = {
            str(row['id']): [row['clearance'], row['required']]
            for row in self.rows('hazards', space)
        }
        spans = {
            f'{row["line_id"]}/{row["span_id"]}': [row['length'], row['sag']]
            for row in self.rows('catenaries', space)
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


def _put_into(space):
    return ('-r', f'__ns:={space}') if space else ()


TOLD_STEP = 0.0055
"""Half of the centimetres that browsers are told, and rounding [m]."""


def agree(shown, published):
    """Whether rows on the page hold the numbers that were published, as far as they show."""
    if {row[0] for row in shown} != set(published):
        return False
    return all(
        abs(float(text) - value) <= 0.5 * 10.0 ** -len(text.partition('.')[2]) + TOLD_STEP
        for name, *texts in shown for text, value in zip(texts, published[name], strict=True)
    )


def shows_what_is_published(chrome, flight, space=''):
    """Whether the page shows the hazards and spans that the node published last."""
    hazards, spans = flight.published(space)
    return bool(spans) and agree(chrome.run(SPANS), spans) and agree(chrome.run(HAZARDS), hazards)
