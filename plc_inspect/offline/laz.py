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

"""Reading LAS and LAZ by a decoder that raises an error on truncated files."""

from pathlib import Path

import laspy

BACKENDS = (laspy.LazBackend.LazrsParallel, laspy.LazBackend.Lazrs)
"""
Those of lazrs.

laspy would try LASzip next where that is installed: version 0.3.0 of its Python package ends the
process with a segmentation fault on some truncated files.
"""


def read_las(path: Path) -> laspy.LasData:
    """
    Read a LAS or LAZ file whole.

    Errors are those of laspy, lazrs, struct, numpy and the system, as they come.
    """
    return laspy.read(path, laz_backend=BACKENDS)
