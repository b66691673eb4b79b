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
The transport that scans need: Fast DDS loses four of five large messages on its default.

A scan of 30,000 points is 660 kB; sent best effort it does not fit the default buffers.  Both
ends need the same setting, or the equivalent ``config/fastdds.xml``.
"""

import os

VARIABLE = 'FASTDDS_BUILTIN_TRANSPORTS'
VALUE = 'LARGE_DATA?max_msg_size=2MB&sockets_size=4MB&non_blocking=true'
PROFILE_VARIABLES = ('FASTRTPS_DEFAULT_PROFILES_FILE', 'FASTDDS_DEFAULT_PROFILES_FILE')
ADVICE = (
    f'start the driver with {VARIABLE}={VALUE} or with config/fastdds.xml, as plc_node does'
)


def prepare_transport() -> None:
    """Choose the transport for large messages, unless the user chose one; before rclpy.init."""
    if not any(name in os.environ for name in PROFILE_VARIABLES):
        os.environ.setdefault(VARIABLE, VALUE)
