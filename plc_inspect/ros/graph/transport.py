# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
The transport that scans need: Fast DDS loses four of five large messages on its default.

A scan of 30,000 points is 660 kB; sent best effort it does not fit the default shared memory.
``config/fastdds.xml`` makes it large enough, and the sender decides: with the file at the sender
all of 100 scans arrive, with it at the receiver alone 13.  FASTDDS_BUILTIN_TRANSPORTS with its
LARGE_DATA is no way out: rmw_fastrtps does not listen to it where discovery is limited to the
machine (43 of 100 arrive), and its TCP part can end the process when a peer leaves.
"""

import os
import warnings

from plc_inspect.printable import make_one_line
from plc_inspect.security.member_keys import find_keys, PROFILE
from plc_inspect.shared_files import find_shared

VARIABLE = 'FASTRTPS_DEFAULT_PROFILES_FILE'
CHOICES = (VARIABLE, 'FASTDDS_DEFAULT_PROFILES_FILE', 'FASTDDS_BUILTIN_TRANSPORTS')
"""Variables by which a user chooses the transport."""
ADVICE = (
    f"start the driver with {VARIABLE} set to the path of plc_inspect's config/{PROFILE}, "
    'as plc_node does'
)


NO_PLUGINS = (
    'this Fast DDS has no security plugins; use TLS: docs/security.md (and unset '
    'ROS_SECURITY_ENABLE), or a sourced Jazzy, which has them'
)


def explain_start(error: Exception) -> str:
    """Return in one line why a node did not come up."""
    text = make_one_line(error)
    return NO_PLUGINS if 'security libraries' in text else text


def lacks_plugins(error: Exception) -> bool:
    """Tell whether a node did not come up because its Fast DDS knows no DDS Security."""
    return explain_start(error) is NO_PLUGINS


def prepare_transport() -> None:
    """
    Choose the transport, unless the user chose one; before rclpy.init.

    That is the profile of the keys that PLC_KEYS names, or one for large messages.

    Raises
    ------
    ConfigError
        PLC_KEYS names no keys.

    """
    # Where a node does not come up, what is said of it is enough.
    warnings.filterwarnings('ignore', 'Failed to fini rosout publisher', RuntimeWarning)
    keys = find_keys()
    if any(os.environ.get(name) for name in CHOICES):
        return
    profile = None if keys is None else keys.profile
    profile = profile or find_shared(PROFILE)
    if profile is not None:
        os.environ[VARIABLE] = str(profile)
