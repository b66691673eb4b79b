# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
Takes the pictures of the monitor's page for the documentation, during the demo flight.

It needs an installed Chromium.
"""

import argparse
import os
from pathlib import Path
import subprocess
import sys
import tempfile
import time

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT / 'test'))

from monitor.web.chrome import Chrome, stop_playing  # noqa: E402

from plc_inspect.offline.report.browser import find_browser  # noqa: E402
from plc_inspect.ros.graph.domain import take_domain  # noqa: E402

COMMANDS = {
    'page': ('plc_inspect.monitor.command', '--web', '--port', '0'),
    'node': ('plc_inspect.ros.node.onboard', '--ros-args', '--log-level', 'warn', '-p'),
    'player': ('plc_inspect.ros.play', 'bags/demo', '--wait', '30', '--quiet'),
}
SIZES = {'desk': (1440, 900), 'tablet': (1024, 768), 'phone': (390, 844)}
SECONDS = 4.0
"""After the first hazard the first picture is taken [s]."""


def main() -> None:
    """Take the pictures."""
    parser = argparse.ArgumentParser(description='Takes the pictures of the monitor.')
    parser.add_argument('folder', type=Path, metavar='FOLDER')
    folder = parser.parse_args().folder.resolve()
    environment = os.environ | {
        'ROS_DOMAIN_ID': str(take_domain()), 'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST',
    }
    with tempfile.TemporaryDirectory() as room:
        processes = {}
        try:
            for name, words in COMMANDS.items():
                extra = [f'output.directory:={room}/out'] if name == 'node' else []
                processes[name] = subprocess.Popen(
                    [sys.executable, '-m', *words, *extra], cwd=ROOT, env=environment, text=True,
                    stdout=subprocess.PIPE if name == 'page' else None,
                )
            address = processes['page'].stdout.readline().split()[-1]
            shown = [(name, theme) for theme in ('dark', 'light') for name in SIZES]
            for number, (name, theme) in enumerate(shown):
                # One after the other: each draws in software.
                chrome = Chrome(find_browser(), Path(room) / str(number), *SIZES[name],
                                light=theme == 'light')
                chrome.open(address)
                chrome.wait("document.querySelectorAll('#hazards tr').length > 0", 90.0)
                chrome.wait("performance.getEntriesByName('picture').length", 60.0)
                if not number:
                    time.sleep(SECONDS)
                if name == 'tablet':
                    chrome.run("station.scene.setView('overview')")
                chrome.page.wait_for_timeout(1500)
                chrome.take_picture(folder / f'monitor_{name}_{theme}.png')
                chrome.close()
        finally:
            stop_playing()
            for process in processes.values():
                process.kill()
                process.wait()


if __name__ == '__main__':
    main()
