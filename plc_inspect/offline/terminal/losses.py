# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""What of a recorded flight is missing in its map, or not proven."""

from plc_inspect.core.extraction.dust import describe_air
from plc_inspect.core.setup.sharpness import ON_TRUST
from plc_inspect.offline.export.file_names import BEFORE
from plc_inspect.offline.records.inspection import Inspection


def describe_losses(inspection: Inspection) -> str:
    """Return a text about the input missing in the map, or not proven, '' if nothing is."""
    counts = inspection.counts
    parts = [counts['mount_doubt']] if counts.get('mount_doubt') else []
    parts += [part['text'] for part in counts.get('parts', [])]
    if inspection.result.hazards and not counts['sharpness']['known']:
        parts.append(ON_TRUST)
    if dust := describe_air(inspection.result.stages):
        parts.append(dust)
    for title, key in (
        ('scans dropped', 'scans_dropped'),
        ('poses rejected', 'poses_rejected'),
        ('messages skipped', 'skipped'),
    ):
        reasons = ', '.join(f'{number} {reason}' for reason, number in counts[key].items())
        if reasons:
            parts.append(f'{title}: {reasons}')
    if counts['num_map_restarts']:
        num = len(inspection.earlier)
        names = ', '.join(BEFORE.format(number) for number in range(1, num + 1))
        parts.append(
            f'the map was begun anew {counts["num_map_restarts"]} times: what was flown before is '
            + (f'in {names}, in the results folder' if num else 'not in the results')
        )
    if counts['num_scans_lost']:
        parts.append(f'scans missing in the recording: {counts["num_scans_lost"]}')
    return '\n'.join(parts)
