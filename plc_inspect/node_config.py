# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Settings that only the node reads, each with its default, unit and range."""

from dataclasses import dataclass

from plc_inspect.setting import Checked, setting


@dataclass(frozen=True, slots=True, kw_only=True)
class ProximitySettings(Checked):
    """Least distances of the vehicle to conductors, supports and other objects."""

    warning: float = setting(
        15.0, 'nearer than this is a warning', unit='m', low=0.5, high=60.0
    )
    critical: float = setting(
        8.0, 'nearer than this is critical', unit='m', low=0.0, high=60.0
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class OutputSettings(Checked):
    """Output of the node; the commands take theirs as arguments."""

    directory: str = setting(
        '',
        'results folder of plc_node, replaced at every save; empty: a new one below ~/.ros',
        structural=True,
    )
    record: bool = setting(
        True,
        'write a flight record beside the results folder, which survives a crash',
        structural=True,
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class StreamSettings(Checked):
    """The stream from the node to ground stations over a thin link."""

    max_kbps: float = setting(
        192.0,
        'rate that summary and thinned corridor keep to, for each monitor: three quarters of what '
        'the link carries, as what is lost is sent again; 0: no corridor',
        unit='kbit/s', low=0.0, high=100_000.0,
    )
    voxel_size: float = setting(
        0.5, 'edge of a cell of the thinned corridor', unit='m', low=0.1, high=10.0,
        structural=True,
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class SecuritySettings(Checked):
    """Access over the network; see docs/security.md."""

    require: str = setting(
        'off', 'the node starts on nothing less: TLS or DDS Security; off: it warns',
        choices=('off', 'tls', 'sros2'), structural=True,
    )
