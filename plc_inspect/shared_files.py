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

"""Where the files of ``config/`` are: in the source tree, or where they are installed."""

import os
from pathlib import Path
import sys


def find_shared(name: str) -> Path | None:
    """Return a file or folder of ``config/``, None if there is none of this name."""
    homes = [
        Path(__file__).parents[1],
        *(Path(item, 'share', 'plc_inspect')
          for item in os.environ.get('AMENT_PREFIX_PATH', '').split(os.pathsep) if item),
        Path(sys.prefix, 'share', 'plc_inspect'),
        Path(sys.prefix, 'local', 'share', 'plc_inspect'),
    ]
    return next((path for home in homes if (path := home / 'config' / name).exists()), None)
