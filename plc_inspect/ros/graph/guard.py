# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""The node's guard: it refuses to start on less than is required, and says who may come in."""

from diagnostic_msgs.msg import DiagnosticStatus, KeyValue

from plc_inspect.errors import ConfigError
from plc_inspect.node_config import SecuritySettings
from plc_inspect.security.exposure import Exposure, look_at_exposure, WARN_DAYS
from plc_inspect.security.member_keys import find_keys


class Guard:
    """
    Looks at the node's sockets once, when they are open.

    Parameters
    ----------
    settings : SecuritySettings
        What is required.

    Raises
    ------
    ConfigError
        There is less, or PLC_KEYS names keys that cannot be read.

    """

    def __init__(self, settings: SecuritySettings) -> None:
        self._keys = find_keys()
        self._exposure = look_at_exposure()
        self._exposure.demand(settings.require)

    def describe(self) -> DiagnosticStatus:
        """Return who may come in, and for how long the certificates hold."""
        days, fault = None, ''
        try:
            days = None if self._keys is None else self._keys.days_left()
        except ConfigError as error:  # they may be replaced just now: the flight goes on
            fault = str(error)
        return describe_security(self._exposure, days, fault)


def describe_security(
    exposure: Exposure, days_left: int | None, fault: str = ''
) -> DiagnosticStatus:
    """
    Describe who may come in.

    Parameters
    ----------
    exposure : Exposure
        What was open when the node started.
    days_left : int or None
        For how long the certificates hold [d], None where there are none.
    fault : str
        Why the certificates cannot be read, '' if they can.

    Returns
    -------
    DiagnosticStatus

    """
    level, text = DiagnosticStatus.OK, exposure.describe()
    if exposure.open_doors and not exposure.sros2:
        level = DiagnosticStatus.WARN
    if fault:
        level, text = DiagnosticStatus.WARN, f'{fault}; {text}'
    if days_left is not None and days_left < WARN_DAYS:
        level = DiagnosticStatus.WARN
        ends = f'end in {days_left} days' if days_left >= 0 else 'have ended'
        text = f'certificates {ends}: plc_keys renew; {text}'
    values = {
        'open': ', '.join(exposure.open_doors) or 'none',
        'TLS': ', '.join(f'{host}:{port}' for host, port in exposure.closed) or 'none',
        'DDS Security': exposure.sros2,
        'certificates end in [d]': (
            'unknown' if fault else 'none' if days_left is None else days_left
        ),
    }
    return DiagnosticStatus(
        level=level, name='security', message=text,
        values=[KeyValue(key=key, value=str(value)) for key, value in values.items()],
    )
