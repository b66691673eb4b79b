# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""The picture as plain values, for ``--json``."""

import dataclasses
import json
import math
from typing import Any

from plc_inspect.monitor.picture.condition import judge
from plc_inspect.monitor.picture.picture import name_severity, Picture
from plc_inspect.stream.summary import STATUSES


def make_snapshot(picture: Picture) -> dict[str, Any]:
    """
    Return the picture as JSON values.

    Parameters
    ----------
    picture : Picture
        What is known.

    Returns
    -------
    dict
        Ages and lengths in seconds and metres; None for NaN.

    """
    record = {
        'link': picture.link.value,
        'complete': picture.complete,
        'session': picture.session,
        'age': _clean(dataclasses.asdict(picture.ages)),
        'counts': _clean(dataclasses.asdict(picture.counts)),
        'frame_id': picture.frame_id,
        'stamp': picture.stamp_ns * 1e-9 if picture.stamp_ns else None,
        'vehicle': _clean(picture.vehicle),
        'status': [
            {'name': name, 'level': level, 'text': text}
            for name, level, text in zip(
                STATUSES, picture.levels, picture.texts, strict=True
            )
        ],
        'health': _clean(dict(picture.health)),
        'state': _clean(dataclasses.asdict(judge(picture))),
        'heading': _clean(picture.heading),
        'height': _clean(picture.height),
        'near': [
            _clean(dataclasses.asdict(item)) | {
                'thing': item.thing.name.lower(), 'level': item.level.name.lower(),
            } for item in picture.near
        ],
        'alarms': [
            {'number': item.number, 'state': item.state, 'text': item.text,
             'hazard_id': item.cause.hazard_id, 'raised': _ago(picture, item.raised),
             'cleared': _ago(picture, item.cleared), 'who': item.who,
             'acknowledged': _ago(picture, item.acknowledged)}
            for item in (*picture.alarms, *picture.past_alarms)
        ],
        'held_back': picture.held_back,
        'hazards': [
            _clean(dataclasses.asdict(item)) | {'severity': item.severity_name}
            for item in picture.hazards
        ],
        'spans': [
            _clean(dataclasses.asdict(item)) | {'severity': name_severity(item.severity)}
            for item in picture.spans
        ],
        'supports': [_clean(dataclasses.asdict(item)) for item in picture.supports],
        'corridor': {
            'blocks': picture.cloud_blocks, 'of': picture.cloud_total,
            'cells': picture.cloud_cells,
        },
        'events': [
            {'ago': round(picture.time - item.time, 3), 'level': item.level, 'text': item.text}
            for item in picture.events
        ],
    }
    return record


def format_snapshot(picture: Picture) -> str:
    """Return the picture as one line of JSON."""
    return json.dumps(make_snapshot(picture), allow_nan=False, separators=(',', ':'))


def _ago(picture: Picture, time: float) -> float | None:
    """Return the age of a time [s]."""
    return None if math.isnan(time) else round(picture.time - time, 3)


def _clean(value: Any) -> Any:
    """Return JSON values, rounded to the resolution of the stream."""
    if isinstance(value, dict):
        return {key: _clean(item) for key, item in value.items()}
    if isinstance(value, tuple | list):
        return [_clean(item) for item in value]
    if isinstance(value, float):
        return round(value, 4) if math.isfinite(value) else None
    return value
