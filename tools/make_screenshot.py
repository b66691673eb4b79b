# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
Takes the screenshot of a report for the documentation.

``make picture`` replays the demo flight and runs this; it needs an installed Chromium.
"""

import argparse
from pathlib import Path

from plc_inspect.offline.report.browser import take_screenshot

if __name__ == '__main__':
    parser = argparse.ArgumentParser(description='Takes the screenshot of a report.')
    parser.add_argument('page', type=Path, metavar='REPORT')
    parser.add_argument('path', type=Path, metavar='PNG')
    parser.add_argument('--height', type=int, default=1750)
    arguments = parser.parse_args()
    take_screenshot(arguments.page, arguments.path, height=arguments.height)
