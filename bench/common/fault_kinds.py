# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""All kinds of faults that ``bench/faults.py`` does to the node."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
import signal
from typing import Any

from common.flight_faults import (
    clear_stamp,
    copy_scans,
    count_microseconds,
    crowd_stamps,
    each,
    Event,
    lengthen_row,
    lower,
    move_to_utm,
    place_scans,
    shift_stamp,
    swap,
    thin_odometry,
    turn_bytes,
    UTM,
)
from common.odometry_changes import (
    blank,
    break_position,
    cut,
    delay,
    drift_back,
    drop,
    empty,
    every,
    exchange,
    forget_times,
    freeze,
    garble,
    HALF,
    move_poses,
    negate_turn,
    rename_frame,
    second_odometry,
    shift_all,
    spoil_stamp,
    step,
    swell,
)
from common.vehicle_faults import (
    clear_covariance,
    clear_frame,
    drift_heading,
    hold_positions,
    jitter,
    land,
    make_dust,
    play_again,
    put_w_first,
    replace_lidar,
    restart_odometry,
    rotate_fields,
    round_to_utm,
    shift_more,
    spoil_turn,
    start_late,
    stretch,
    tell_ned,
    turn_frame,
    turn_poses,
    zero_times,
)


@dataclass(kw_only=True)
class Fault:
    """A kind of fault: what it does to the flight, to the node's start, and to its life."""

    change: Callable[[list[Event]], list[Event]] = lambda events: events
    arguments: tuple[str, ...] = ()
    before: Callable[[Path], None] = lambda out: None
    """Done when the node is ready."""
    during: Callable[[Any], str] = lambda feeder: ''
    """Done in the middle of the flight, by the feeder of ``bench/faults.py``; returns a note."""
    number: int = signal.SIGINT
    file_size: int | None = None
    disk: str = ''
    """Options of a tmpfs that the output folder is on, '' for the folder of all else."""
    offset: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """By which the fault moves the results [m]."""
    is_scaled: bool = False
    """Where the corrected map begins cannot be told then: the results may be off as a whole."""


def put_foreign_file(out: Path) -> None:
    out.mkdir(exist_ok=True)
    (out / 'mine.txt').write_text('keep', encoding='utf-8')


FAULTS = {
    'none': Fault(),
    'SIGHUP at the end': Fault(number=signal.SIGHUP),
    'SIGQUIT at the end': Fault(number=signal.SIGQUIT),
    'files of 100 kB at most': Fault(file_size=100_000),
    'disk of 3 MB': Fault(disk='size=3m'),
    'read-only disk': Fault(disk='size=3m,ro'),
    'disk full from half on': Fault(disk='size=60m', during=lambda feeder: feeder.fill_disk()),
    'output folder of something else': Fault(before=put_foreign_file),
    'hazards.rules unknown at the start': Fault(arguments=('-p', 'hazards.rules:=nonsense')),
    'hazards.rules unknown in flight': Fault(
        during=lambda feeder: feeder.set_parameter('hazards.rules', 'nonsense')
    ),
    'a shipped rule set': Fault(
        arguments=('-p', 'hazards.rules:=en50423_cz', '-p', 'hazards.voltage:=22.0')
    ),
    '200 calls of ~/segment': Fault(during=lambda feeder: feeder.call_often('segment', 200)),
    'two drivers, the second 2 m lower': Fault(change=copy_scans(0.05, lower, 'second')),
    'every scan twice': Fault(change=copy_scans(0.005, lambda message: None)),
    'x and y swapped from half on': Fault(change=each('scan', swap, 10.0)),
    'stamps a microsecond apart': Fault(change=crowd_stamps),
    'all scans malformed from half on': Fault(change=each('scan', lengthen_row, 10.0)),
    'other byte order from half on': Fault(change=each('scan', turn_bytes, 10.0)),
    'all stamps zero': Fault(change=each('scan', clear_stamp)),
    'lidar clock 18 s ahead': Fault(change=each('scan', lambda m: shift_stamp(m, 18.0))),
    'times in microseconds (uint32)': Fault(change=each('scan', count_microseconds)),
    'odometry at 3 Hz': Fault(change=thin_odometry),
    'cloud in the frame of the odometry': Fault(change=place_scans),
    'mount 5 degrees off': Fault(arguments=('-p', 'input.lidar_rpy_deg:=[0.0, 5.0, 0.0]')),
    'mount 30 degrees off': Fault(arguments=('-p', 'input.lidar_rpy_deg:=[0.0, 30.0, 0.0]')),
    'lidar clock 0.2 s ahead': Fault(change=each('scan', lambda m: shift_stamp(m, 0.2))),
    'origin first, then UTM': Fault(change=move_to_utm, offset=UTM),
    'odometry steps by 0.5 m': Fault(change=step(0.0, 0.4, 0.3), offset=(0.0, 0.4, 0.3)),
    'odometry steps by 5 m': Fault(change=step(0.0, 5.0, 0.0), offset=(0.0, 5.0, 0.0)),
    'there and back, no fault': Fault(change=drift_back),
    'there and back, drift of 5 cm/s': Fault(
        change=lambda events: drift_back(events, rate=0.05), offset=(0.0, 0.0, 1.0)
    ),
    'there and back, heading drifts at the end': Fault(
        change=lambda events: drift_heading(1.0, 15.0)(drift_back(events))
    ),
    'odometry stands still for 5 s': Fault(change=freeze),
    'odometry silent for 5 s': Fault(change=drop('odometry', 5.0)),
    'odometry 1.5 s late': Fault(change=delay('odometry', 3.0)),
    'frame of the odometry changes': Fault(change=rename_frame('odometry', 'map')),
    'frame of the lidar changes': Fault(change=rename_frame('scan', 'lidar_top')),
    'two odometries, 1 m apart': Fault(change=second_odometry),
    'one pose 1,000 km away': Fault(change=move_poses(
        lambda time: (1e6, 0.0, 0.0) if HALF < time < HALF + 0.02 else None
    )),
    'poses of 1e300 m for 0.3 s': Fault(change=move_poses(
        lambda time: (1e300, 0.0, 0.0) if HALF < time < HALF + 0.3 else None
    )),
    'poses of NaN for 1 s': Fault(change=break_position),
    'quaternions of the other sign': Fault(change=every(2, 'odometry', negate_turn)),
    'scans out of order': Fault(change=exchange('scan')),
    'poses out of order': Fault(change=exchange('odometry')),
    'one scan in ten 1 h ahead': Fault(
        change=every(10, 'scan', lambda message: shift_stamp(message, 3600.0))
    ),
    'one pose in a thousand 1 h ahead': Fault(
        change=every(1000, 'odometry', lambda message: shift_stamp(message, 3600.0))
    ),
    'all stamps 1 h ahead from half on': Fault(change=shift_all(3600.0)),
    'all stamps 1 h back from half on': Fault(change=shift_all(-3600.0)),
    'stamps that are no time, one in ten': Fault(change=every(10, 'scan', spoil_stamp)),
    'one scan in ten cut': Fault(change=every(10, 'scan', cut)),
    'one scan in ten not finite': Fault(change=every(10, 'scan', blank)),
    'one scan in ten empty': Fault(change=every(10, 'scan', empty)),
    'scans without times': Fault(change=each('scan', forget_times)),
    'scans without times from half on': Fault(change=each('scan', forget_times, 10.0)),
    'one scan of 2,000,000 points': Fault(change=swell),
    'damaged messages': Fault(change=garble),
    'driver away for 3 s': Fault(change=drop('scan', 3.0)),
    'node stopped for 3 s': Fault(during=lambda feeder: feeder.stop_node(3.0)),
    'map of 400,000 voxels': Fault(arguments=('-p', 'map.max_voxels:=400000')),
    'map full at 60,000 voxels': Fault(arguments=('-p', 'map.max_voxels:=60000')),
    'lidar clock 1 % fast': Fault(change=shift_more('scan', 0.01)),
    'odometry clock 1 % fast': Fault(change=shift_more('odometry', 0.01)),
    'stamps of arrival, 30 ms off': Fault(change=jitter(0.03)),
    'a lidar of another frame starts at half': Fault(change=start_late('rear_lidar')),
    'no lidar until half, of another frame': Fault(change=replace_lidar('rear_lidar')),
    'quaternions of NaN for 0.5 s': Fault(change=turn_poses(spoil_turn)),
    'quaternions with w first': Fault(change=turn_poses(put_w_first)),
    'odometry back at the origin at the end': Fault(change=land),
    'odometry starts anew at half': Fault(change=restart_odometry),
    'frame of the odometry turned by 90 degrees': Fault(change=turn_frame(90.0)),
    'heading drifts by 1 degree/s': Fault(change=drift_heading(1.0)),
    'odometry in UTM through float32': Fault(change=turn_poses(round_to_utm), offset=UTM),
    'positions as north, east, down': Fault(change=turn_poses(tell_ned)),
    'positions 5 % too long': Fault(change=stretch(1.05), is_scaled=True),
    'positions 2 % too long': Fault(change=stretch(1.02), is_scaled=True),
    'positions 10 % too short': Fault(change=stretch(0.9), is_scaled=True),
    'positions at 10 Hz, told at 50 Hz': Fault(change=hold_positions(0.1)),
    'positions at 5 Hz, told at 50 Hz': Fault(change=hold_positions(0.2)),
    'positions at 10 Hz, told at 50 Hz, one in ten lost': Fault(change=hold_positions(0.1, 0.1)),
    'poses 3 s late': Fault(change=delay('odometry', 6.0)),
    'covariance of zero': Fault(change=each('odometry', clear_covariance)),
    'no frame of scans': Fault(change=each('scan', clear_frame)),
    'no frame of odometry': Fault(change=each('odometry', clear_frame)),
    'z stored before x and y': Fault(change=each('scan', rotate_fields)),
    'z stored before x and y from half on': Fault(change=each('scan', rotate_fields, 10.0)),
    'times of points at zero': Fault(change=each('scan', zero_times)),
    'one point in a thousand is dust': Fault(change=make_dust(0.001)),
    'one point in a hundred is dust': Fault(change=make_dust(0.01)),
    'one point in ten is dust': Fault(change=make_dust(0.1)),
    'first half played twice': Fault(change=play_again),
}
