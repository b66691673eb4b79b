# Copyright 2026 plc_inspect contributors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""
Takes the screenshot of a report for the documentation.

``make picture`` replays the demo flight and runs this; it needs an installed Chromium.
"""

import argparse
from pathlib import Path

from plc_inspect.offline.browser import take_screenshot

if __name__ == '__main__':
    parser = argparse.ArgumentParser(description='Takes the screenshot of a report.')
    parser.add_argument('page', type=Path, metavar='REPORT')
    parser.add_argument('path', type=Path, metavar='PNG')
    parser.add_argument('--height', type=int, default=1750)
    arguments = parser.parse_args()
    take_screenshot(arguments.page, arguments.path, height=arguments.height)
