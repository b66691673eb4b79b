# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Paths of the files of ``config/``, and of files kept between runs."""

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


def find_home() -> Path:
    """Return the default folder for files of the package, below ROS_HOME (~/.ros)."""
    return Path(os.environ.get('ROS_HOME') or Path.home() / '.ros') / 'plc_inspect'
