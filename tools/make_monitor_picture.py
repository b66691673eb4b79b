# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
Takes the picture of the monitor's page for the documentation, during the demo flight.

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

from chrome import Chrome  # noqa: E402

from plc_inspect.offline.report.browser import find_browser  # noqa: E402

COMMANDS = {
    'page': ('plc_inspect.monitor.command', '--web', '--port', '0'),
    'node': ('plc_inspect.ros.node.onboard', '--ros-args', '--log-level', 'warn', '-p'),
    'player': ('plc_inspect.ros.play', 'bags/demo', '--wait', '30', '--quiet'),
}
SIZE = 1280, 720
SECONDS = 38.0
"""When in the flight the picture is taken [s]."""
CLOSE = "document.querySelector('.mantine-Notification-closeButton')?.click()"


def main() -> None:
    """Take the picture."""
    parser = argparse.ArgumentParser(description='Takes the picture of the monitor.')
    parser.add_argument('path', type=Path, metavar='PNG')
    path = parser.parse_args().path.resolve()
    environment = os.environ | {
        'ROS_DOMAIN_ID': str(1 + os.getpid() % 100), 'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST',
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
            chrome = Chrome(find_browser(), Path(room) / 'profile', *SIZE)
            chrome.open(processes['page'].stdout.readline().split()[-1])
            chrome.wait("document.querySelector('#plc-link')?.dataset.link == 'live'", 60.0)
            chrome.wait("document.querySelectorAll('#plc-hazards tr').length > 1", 60.0)
            time.sleep(SECONDS)
            chrome.run(CLOSE)
            time.sleep(1.0)
            chrome.take_picture(path)
            chrome.close()
        finally:
            for process in processes.values():
                process.kill()
                process.wait()


if __name__ == '__main__':
    main()
