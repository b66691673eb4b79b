# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""The scores of one evaluation, and their table."""

from collections.abc import Sequence
import dataclasses
from dataclasses import dataclass, field
import math
from typing import Any


@dataclass(frozen=True, slots=True, kw_only=True)
class WireScores:
    """Scores of the classification of wire points."""

    true_positives: int
    false_positives: int
    false_negatives: int
    left_out: int
    """Points without a certain truth."""

    @property
    def precision(self) -> float:
        """Share of the points classified as wire that are wire; NaN if there are none."""
        return _divide(self.true_positives, self.true_positives + self.false_positives)

    @property
    def recall(self) -> float:
        """Share of the wire points classified as wire; NaN if there are none."""
        return _divide(self.true_positives, self.true_positives + self.false_negatives)

    @property
    def f1(self) -> float:
        """Harmonic mean of precision and recall; NaN if neither exists."""
        wrong = self.false_positives + self.false_negatives
        return _divide(2 * self.true_positives, 2 * self.true_positives + wrong)

    @property
    def iou(self) -> float:
        """Intersection over union; NaN if both are empty."""
        wrong = self.false_positives + self.false_negatives
        return _divide(self.true_positives, self.true_positives + wrong)


def _divide(part: int, whole: int) -> float:
    return part / whole if whole else math.nan


@dataclass(frozen=True, slots=True, kw_only=True)
class Counts:
    """Counts of true items and reported ones."""

    required: int = 0
    """Items that must be found: spans seen over 60 %, supports seen, clear hazards."""
    required_found: int = 0
    found: int = 0
    """True items that were found, required or not."""
    false: int = 0
    missed: tuple[str, ...] = ()
    """Names of the required items that were missed."""
    false_names: tuple[str, ...] = ()

    @property
    def recall(self) -> float:
        """Share of the required items that were found; NaN if there are none."""
        return _divide(self.required_found, self.required)


@dataclass(frozen=True, slots=True, kw_only=True)
class Errors:
    """Absolute errors [m]."""

    values: tuple[float, ...] = ()

    @property
    def median(self) -> float:
        """Median; NaN without values."""
        return self.quantile(0.5)

    @property
    def p95(self) -> float:
        """95th percentile; NaN without values."""
        return self.quantile(0.95)

    @property
    def largest(self) -> float:
        """Largest; NaN without values."""
        return self.quantile(1.0)

    @property
    def rms(self) -> float:
        """Root mean square; NaN without values."""
        if not self.values:
            return math.nan
        return math.sqrt(sum(value**2 for value in self.values) / len(self.values))

    def quantile(self, share: float) -> float:
        """Return the linearly interpolated quantile; NaN without values."""
        if not self.values:
            return math.nan
        ordered = sorted(self.values)
        at = share * (len(ordered) - 1)
        low = math.floor(at)
        high = min(low + 1, len(ordered) - 1)
        return ordered[low] + (at - low) * (ordered[high] - ordered[low])


@dataclass(frozen=True, slots=True, kw_only=True)
class Scores:
    """All scores of one results folder against one truth."""

    name: str
    wire: WireScores | None
    """None if the truth has neither labels nor spans."""
    spans: Counts = Counts()
    num_spans: int = 0
    """Number of spans in the results."""
    num_lines: int = 0
    """Number of lines in the results."""
    lateral_rmse: Errors = Errors()
    """Lateral RMS distance of each found span."""
    vertical_rmse: Errors = Errors()
    """Vertical RMS distance of each found span."""
    sag: Errors = Errors()
    clearance: Errors = Errors()
    """Distance from conductor to nearest vegetation, of each found span."""
    supports: Counts = Counts()
    support_position: Errors = Errors()
    """In plan."""
    hazards: Counts = Counts()
    hazards_repeated: int = 0
    """Further reports of a found hazard on the same conductor-span."""
    hazards_of_other_kind: int = 0
    """Reports at a true hazard of another kind."""
    hazard_clearance: Errors = field(default_factory=Errors)
    only_labels: bool = False
    """Whether the truth holds only the classes of points."""


def to_mapping(scores: Scores) -> dict[str, Any]:
    """Return the scores as plain JSON values, NaN as null."""
    result: dict[str, Any] = {'name': scores.name}
    wire = scores.wire
    result['wire'] = None if wire is None else {
        **dataclasses.asdict(wire), 'precision': _plain(wire.precision),
        'recall': _plain(wire.recall), 'f1': _plain(wire.f1), 'iou': _plain(wire.iou),
    }
    if scores.only_labels:
        return {**result, 'num_spans': scores.num_spans, 'num_lines': scores.num_lines}
    for item in dataclasses.fields(scores):
        value = getattr(scores, item.name)
        if isinstance(value, Counts):
            result[item.name] = {
                **{key: list(entry) if isinstance(entry, tuple) else entry
                   for key, entry in dataclasses.asdict(value).items()},
                'recall': _plain(value.recall),
            }
        elif isinstance(value, Errors):
            result[item.name] = {
                'count': len(value.values), 'median': _plain(value.median),
                'p95': _plain(value.p95), 'max': _plain(value.largest), 'rms': _plain(value.rms),
            }
        elif isinstance(value, int) and not isinstance(value, bool):
            result[item.name] = value
    return result


def _plain(value: float) -> float | None:
    return None if math.isnan(value) else value


def format_table(scores: Scores) -> str:
    """Return the scores as a table for people."""
    rows: list[tuple[str, str]] = []
    if scores.wire is not None:
        wire = scores.wire
        rows.append(('wire points', ', '.join((
            f'precision {_share(wire.precision)}', f'recall {_share(wire.recall)}',
            f'F1 {_share(wire.f1)}', f'IoU {_share(wire.iou)}',
        ))))
    rows.append(('result', f'{scores.num_lines} lines, {scores.num_spans} conductor-spans'))
    if not scores.only_labels:
        rows += [
            ('conductor-spans', _count(scores.spans)),
            ('lateral RMSE', _errors(scores.lateral_rmse)),
            ('vertical RMSE', _errors(scores.vertical_rmse)),
            ('sag error', _errors(scores.sag)),
            ('distance to vegetation', _errors(scores.clearance)),
            ('supports', _count(scores.supports)),
            ('support position', _errors(scores.support_position)),
            ('hazards', _count(scores.hazards) + (
                f', {scores.hazards_repeated} repeated' if scores.hazards_repeated else ''
            ) + (
                f', {scores.hazards_of_other_kind} of another kind'
                if scores.hazards_of_other_kind else ''
            )),
            ('hazard clearance', _errors(scores.hazard_clearance)),
        ]
        for name, counts in (('span', scores.spans), ('support', scores.supports),
                             ('hazard', scores.hazards)):
            rows += [(f'missed {name}', text) for text in counts.missed]
            rows += [(f'false {name}', text) for text in counts.false_names]
    return _lay_out(rows)


def _lay_out(rows: Sequence[tuple[str, str]]) -> str:
    width = max(len(name) for name, _ in rows)
    return '\n'.join(f'{name:<{width}}  {text}' for name, text in rows)


def _share(value: float) -> str:
    return '-' if math.isnan(value) else f'{value:.4f}'


def _count(counts: Counts) -> str:
    more = counts.found - counts.required_found
    return (
        f'{counts.required_found} of {counts.required} found'
        + (f' (and {more} that need not be)' if more else '') + f', {counts.false} false'
    )


def _errors(errors: Errors) -> str:
    if not errors.values:
        return '-'
    return (
        f'median {errors.median:.3f} m, p95 {errors.p95:.3f} m, max {errors.largest:.3f} m,'
        f' RMS {errors.rms:.3f} m of {len(errors.values)}'
    )
