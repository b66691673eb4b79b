# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Command line ``plc_evaluate``: scores a results folder against the truth."""

import argparse
from collections.abc import Sequence
import json
from pathlib import Path
import sys

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from plc_inspect.core.numerics.boxes import measure_box_gap
from plc_inspect.errors import DataError
from plc_inspect.offline.commands.command_line import DONE, Parser, run_command
from plc_inspect.offline.readers.wire_truth import (
    check_order,
    count_samples,
    DOUBT_DISTANCE,
    label_points,
)
from plc_inspect.printable import make_printable
from plc_inspect.results import PointClass
from plc_inspect.sim.evaluation.curves import Curve
from plc_inspect.sim.evaluation.estimate import FoundHazard, read_survey, Survey
from plc_inspect.sim.evaluation.matching import (
    match_places,
    match_spans,
    measure_sag_error,
    SpanMatches,
    SUPPORT_DISTANCE,
)
from plc_inspect.sim.evaluation.reference import read_truth, TrueHazard, Truth
from plc_inspect.sim.evaluation.scores import (
    Counts,
    Errors,
    format_table,
    Scores,
    to_mapping,
    WireScores,
)

Float64 = NDArray[np.float64]
Bool = NDArray[np.bool_]

NAME = 'plc_evaluate'
MIN_SEEN = 0.6
"""Share of its length over which a conductor-span must be seen to be required."""
BOX_MARGIN = 0.3
"""Margin of the boxes of hazards on conductors, in which points are left out [m]."""
REACH_MARGIN = 0.5
"""Distance from the edge of the corridor within which clearances are not compared [m]."""
HAZARD_DISTANCE = 1.5
"""Greatest distance of a reported hazard from the box of the true one [m]."""


def evaluate(survey: Survey, truth: Truth) -> Scores:
    """
    Score results against the truth.

    Parameters
    ----------
    survey : Survey
        Results, from `read_survey` or `from_result`.
    truth : Truth
        Truth in the same frame and unit, from `read_truth` or `parse_truth`.

    Returns
    -------
    Scores

    Raises
    ------
    DataError
        The truth holds labels for other points, or in another order.

    """
    num_lines = len({item.curve.line_id for item in survey.spans})
    wire = _score_wire(survey, truth)
    if truth.only_labels:
        return Scores(
            name=truth.name, wire=wire, num_spans=len(survey.spans), num_lines=num_lines,
            only_labels=True,
        )
    matches = match_spans(truth, survey)
    supports, support_errors = _score_supports(survey, truth)
    hazards, repeated, other_kind, hazard_errors = _score_hazards(survey, truth, matches)
    return Scores(
        name=truth.name, wire=wire, spans=_count_spans(survey, truth, matches),
        num_spans=len(survey.spans), num_lines=num_lines,
        lateral_rmse=Errors(values=tuple(m.comparison.lateral_rms for m in matches.matches)),
        vertical_rmse=Errors(values=tuple(m.comparison.vertical_rms for m in matches.matches)),
        sag=Errors(values=tuple(
            measure_sag_error(truth.spans[m.truth], survey.spans[m.found])
            for m in matches.matches
        )),
        clearance=_score_clearance(survey, truth, matches), supports=supports,
        support_position=support_errors, hazards=hazards, hazards_repeated=repeated,
        hazards_of_other_kind=other_kind, hazard_clearance=hazard_errors,
    )


def _score_wire(survey: Survey, truth: Truth) -> WireScores | None:
    found = survey.classification == PointClass.WIRE
    if truth.labels is not None:
        if len(truth.labels) != len(found):
            raise DataError(
                f'the results hold {len(found)} points, the labelled cloud {len(truth.labels)}'
            )
        if truth.places is not None:
            check_order(survey.points, truth.places)
        return _count_wire(found, truth.labels == PointClass.WIRE, truth.labels == 0)
    wire, doubt = _label_points(survey.points, truth)
    return _count_wire(found, wire, doubt)


def _count_wire(found: Bool, wire: Bool, left_out: Bool) -> WireScores:
    keep = ~left_out
    return WireScores(
        true_positives=int((found & wire & keep).sum()),
        false_positives=int((found & ~wire & keep).sum()),
        false_negatives=int((~found & wire & keep).sum()), left_out=int(left_out.sum()),
    )


def _label_points(points: Float64, truth: Truth) -> tuple[Bool, Bool]:
    """Return which points are wire, and which are left out, by their distance."""
    wire, doubt = label_points(points, [_sample(item.curve) for item in truth.spans])
    near = np.flatnonzero((wire | doubt) & np.isfinite(points).all(axis=1))
    for hazard in truth.hazards:
        if hazard.clearance < DOUBT_DISTANCE:
            inside = (points[near] >= hazard.extent[0] - BOX_MARGIN).all(axis=1)
            inside &= (points[near] <= hazard.extent[1] + BOX_MARGIN).all(axis=1)
            doubt[near[inside]] = True
    return wire, doubt


def _sample(curve: Curve) -> Float64:
    """Return the (K, 3) points that stand for a conductor [m]."""
    return curve.locate(np.linspace(0.0, curve.length, count_samples(curve.length)))


def _count_spans(survey: Survey, truth: Truth, matches: SpanMatches) -> Counts:
    required = {
        i for i, item in enumerate(truth.spans)
        if item.seen >= MIN_SEEN and i not in matches.excused
    }
    found = {match.truth for match in matches.matches}
    return Counts(
        required=len(required), required_found=len(required & found), found=len(found),
        false=len(matches.false),
        missed=tuple(
            f'line {truth.spans[i].curve.line_id} span {truth.spans[i].curve.span_id},'
            f' seen over {truth.spans[i].seen:.0%}' for i in sorted(required - found)
        ),
        false_names=tuple(
            f'line {curve.line_id} span {curve.span_id}, {curve.length:.1f} m long at'
            f' {_place(curve.start)}'
            for curve in (survey.spans[j].curve for j in matches.false)
        ),
    )


def _place(position: Float64) -> str:
    return f'({position[0]:.1f}, {position[1]:.1f}, {position[2]:.1f})'


def _score_clearance(survey: Survey, truth: Truth, matches: SpanMatches) -> Errors:
    """
    Compare the distances from conductors to the nearest vegetation.

    Only conductors whose nearest object in truth is vegetation within the corridor that the
    results cover: the results tell vegetation from roofs by shape alone.
    """
    near = (survey.classification == PointClass.VEGETATION) & np.isfinite(survey.clearance)
    points = survey.points[near]
    if not len(points):
        return Errors()
    tree, reach = cKDTree(points), float(survey.clearance[near].max())
    errors = []
    for match in matches.matches:
        item = truth.spans[match.truth]
        expected = item.min_vegetation_distance
        if expected is None or expected > reach - REACH_MARGIN or (
            item.min_structure_distance is not None and item.min_structure_distance < expected
        ):
            continue
        curve = survey.spans[match.found].curve
        distance, _ = tree.query(_sample(curve))
        errors.append(abs(float(distance.min()) - expected))
    return Errors(values=tuple(errors))


def _score_supports(survey: Survey, truth: Truth) -> tuple[Counts, Errors]:
    pairs = match_places(truth.supports, survey.supports, SUPPORT_DISTANCE)
    found, used = {i for i, _ in pairs}, {j for _, j in pairs}
    required = set(np.flatnonzero(truth.support_seen).tolist())
    counts = Counts(
        required=len(required), required_found=len(required & found), found=len(found),
        false=len(survey.supports) - len(used),
        missed=tuple(f'at {_place(truth.supports[i])}' for i in sorted(required - found)),
        false_names=tuple(
            f'at {_place(place)}' for j, place in enumerate(survey.supports) if j not in used
        ),
    )
    return counts, Errors(values=tuple(
        float(np.hypot(*(truth.supports[i] - survey.supports[j])[:2])) for i, j in pairs
    ))


def _score_hazards(
    survey: Survey, truth: Truth, matches: SpanMatches,
) -> tuple[Counts, int, int, Errors]:
    """Match reported with true hazards; several reports may match one true hazard."""
    names = {}
    for match in matches.matches:
        curve, other = survey.spans[match.found].curve, truth.spans[match.truth].curve
        names[curve.line_id, curve.span_id] = (other.line_id, other.span_id)
    reports: dict[int, list[FoundHazard]] = {}
    repeated = other_kind = 0
    false = []
    for report in survey.hazards:
        conductor = names.get((report.line_id, report.span_id))
        near = [
            (*_measure_gap(report, item), i) for i, item in enumerate(truth.hazards)
            if conductor is None or not item.conductors or _is_of(item, conductor)
        ]
        near = sorted(row for row in near if row[0] <= HAZARD_DISTANCE)
        same = [i for *_, i in near if truth.hazards[i].kind == report.kind]
        if same:
            known = reports.setdefault(same[0], [])
            repeated += any(
                (item.line_id, item.span_id) == (report.line_id, report.span_id)
                for item in known
            )
            known.append(report)
        elif near:
            other_kind += 1
        else:
            false.append(report)
    required = _list_required(truth)
    counts = Counts(
        required=len(required), required_found=len(required & set(reports)), found=len(reports),
        false=len(false),
        missed=tuple(
            f'{item.kind} {item.clearance:.2f} m at {_place(item.position)}'
            for i, item in enumerate(truth.hazards) if i in required and i not in reports
        ),
        false_names=tuple(
            f'{item.kind} {item.clearance:.2f} m at {_place(item.position)}' for item in false
        ),
    )
    return counts, repeated, other_kind, Errors(values=tuple(
        abs(min(item.clearance for item in known) - truth.hazards[i].clearance)
        for i, known in sorted(reports.items())
    ))


def _list_required(truth: Truth) -> set[int]:
    """Return the hazards that must be found: of low conductors those that were seen."""
    unseen = {
        (item.curve.line_id, item.curve.span_id) for item in truth.spans if item.seen < MIN_SEEN
    }
    return {
        i for i, item in enumerate(truth.hazards) if item.required
        and not (item.kind == 'ground' and item.conductors and unseen >= item.conductors.keys())
    }


def _is_of(item: TrueHazard, conductor: tuple[int, int]) -> bool:
    """Tell whether a hazard is near a conductor, or another one of the same span."""
    return any(span_id == conductor[1] for _, span_id in item.conductors)


def _measure_gap(report: FoundHazard, item: TrueHazard) -> tuple[float, float]:
    """Return the distances of a report from the box of a true hazard and from its position [m]."""
    gap = measure_box_gap(np.stack((report.position, report.position)), item.extent)
    return gap, float(np.linalg.norm(report.position - item.position))


def build_parser() -> argparse.ArgumentParser:
    """Return the parser of ``plc_evaluate``."""
    parser = Parser(prog=NAME, description='Score a results folder against the truth.')
    parser.add_argument('results', metavar='OUT', type=Path, help='results folder')
    parser.add_argument(
        'truth', metavar='TRUTH', type=Path,
        help='truth.json, a folder that holds one, or a labelled LAS or LAZ file',
    )
    parser.add_argument('--json', action='store_true', help='print JSON instead of a table')
    return parser


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command and return its exit code."""
    return run_command(NAME, lambda: _run(argv))


def _run(argv: Sequence[str] | None) -> int:
    arguments = build_parser().parse_args(argv)
    scores = evaluate(read_survey(arguments.results), read_truth(arguments.truth))
    if arguments.json:
        print(json.dumps(to_mapping(scores), indent=1))
    else:
        print(make_printable(format_table(scores)))
    return DONE


if __name__ == '__main__':
    sys.exit(main())
