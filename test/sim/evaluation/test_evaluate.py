# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""The evaluation: scores of results whose faults are known."""

from dataclasses import replace
import importlib
import json
import math
import subprocess
import sys

from factories import make_inspection
import laspy
import numpy as np
import pytest

from plc_inspect.errors import DataError
from plc_inspect.offline.export.results_folder import write_results
from plc_inspect.offline.records.units import Units
from plc_inspect.results import PointClass
from plc_inspect.sim.evaluation.curves import compare, Curve
from plc_inspect.sim.evaluation.estimate import (
    FoundHazard,
    FoundSpan,
    from_result,
    read_survey,
    Survey,
)
from plc_inspect.sim.evaluation.evaluate import evaluate, main
from plc_inspect.sim.evaluation.reference import parse_truth, read_truth
from plc_inspect.sim.evaluation.scores import Errors, format_table, to_mapping, WireScores
from plc_inspect.sim.scenes.conductors import Conductor, hang
from plc_inspect.sim.surveys.truth import describe_conductor


def make_conductors(offsets=(0.0, 0.4, 0.8, 1.2), bundles=None):
    """Make two spans of parallel conductors."""
    return [
        hang(np.array([100.0 * span, y, 15.0]), np.array([100.0 * (span + 1), y, 16.0]), 0.02,
             line_id=line, span_id=span, bundle_id=-1 if bundles is None else bundles[line])
        for line, y in enumerate(offsets) for span in range(2)
    ]


def make_content(conductors, seen=1.0, hazards=()):
    """Make a truth.json."""
    return {
        'kind': 'flight', 'scene': 'toy',
        'spans': [
            {**describe_conductor(item, np.zeros(3)), 'seen': seen, 'seen_from': 0.0,
             'seen_to': item.length, 'min_vegetation_distance': None}
            for item in conductors
        ],
        'supports': [{'position': [x, 0.0, 0.0], 'seen': True} for x in (0.0, 100.0, 200.0)],
        'hazards': list(hazards),
    }


def make_found(item, part=(0.0, 1.0), shift=(0.0, 0.0, 0.0)):
    """Make the estimate of a part of a conductor, moved."""
    ends = item.locate(np.array(part) * item.length) + np.array(shift)
    along = part[0] * item.length
    curve = Curve(line_id=item.line_id, span_id=item.span_id, start=ends[0], end=ends[1],
                  a=item.a + shift[2], b=item.b - along, c=item.c)
    whole = part == (0.0, 1.0)
    sag = item.sag if whole else curve.measure_sag(0.0, curve.length)
    return FoundSpan(curve=curve, sag=sag, open_ended=not whole)


def make_survey(found, points=None, wire=None, hazards=(), supports=None):
    """Make a survey; by default of two points that are no wire."""
    points = np.array([[0.0, 50.0, 0.0], [9.0, 50.0, 0.0]]) if points is None else points
    wire = np.zeros(len(points), bool) if wire is None else wire
    feet = [[x, 0.2, 0.0] for x in (0.0, 100.0, 200.0)] if supports is None else supports
    return Survey(
        spans=tuple(found), supports=np.array(feet, float).reshape(-1, 3),
        hazards=tuple(hazards), points=points,
        classification=np.where(wire, PointClass.WIRE, PointClass.GROUND).astype(np.uint8),
        clearance=np.full(len(points), np.nan),
    )


def score(found, conductors, **options):
    """Evaluate estimates against conductors."""
    return evaluate(make_survey(found), parse_truth(make_content(conductors, **options)))


def test_perfect_result():
    """The truth itself scores full marks."""
    conductors = make_conductors()
    scores = score([make_found(item) for item in conductors], conductors)
    assert (scores.spans.required, scores.spans.required_found, scores.spans.false) == (8, 8, 0)
    assert scores.lateral_rmse.largest == pytest.approx(0.0, abs=1e-9)
    assert scores.vertical_rmse.largest == pytest.approx(0.0, abs=1e-9)
    assert scores.sag.largest == pytest.approx(0.0, abs=1e-9)
    assert scores.supports.required_found == 3
    assert scores.support_position.median == pytest.approx(0.2)
    assert scores.num_lines == 4


def test_known_errors_are_measured():
    """A result that is 5 cm to the left and 3 cm high has just those errors."""
    conductors = make_conductors((0.0, 5.0))
    found = [make_found(item, shift=(0.0, 0.05, 0.03)) for item in conductors]
    scores = score(found, conductors)
    assert scores.lateral_rmse.median == pytest.approx(0.05, abs=1e-4)
    assert scores.vertical_rmse.median == pytest.approx(0.03, abs=1e-4)


def test_empty_result_misses_all():
    """Nothing found: all missed, nothing false."""
    conductors = make_conductors()
    scores = score([], conductors)
    assert (scores.spans.required_found, scores.spans.false) == (0, 0)
    assert len(scores.spans.missed) == 8
    assert np.isnan(scores.vertical_rmse.median)


def test_nothing_there():
    """A line where there is none is false."""
    scores = score([make_found(make_conductors()[0])], [])
    assert (scores.spans.required, scores.spans.false) == (0, 1)


def test_direction_and_ids_do_not_matter():
    """Estimates run either way and have names of their own."""
    item = make_conductors((0.0,))[0]
    back = replace(item, start=item.end, end=item.start, line_id=77, span_id=5)
    scores = score([make_found(back)], [item])
    assert scores.spans.required_found == 1
    assert scores.vertical_rmse.median == pytest.approx(0.0, abs=1e-9)


def test_merged_conductors_are_found_once():
    """One estimate in the middle of two conductors 0.4 m apart is at most one of them."""
    conductors = make_conductors((0.0, 0.4))
    found = [make_found(item, shift=(0.0, 0.19, 0.0)) for item in conductors[:2]]
    scores = score(found, conductors)
    assert (scores.spans.required_found, scores.spans.false) == (2, 0)
    beyond = [make_found(item, shift=(0.0, -0.21, 0.0)) for item in conductors[:2]]
    scores = score(beyond, conductors)
    assert (scores.spans.required_found, scores.spans.false) == (0, 2)


def test_split_and_doubled_spans_are_penalised():
    """Two halves are one miss and two false; a second copy is false."""
    item = make_conductors((0.0,))[0]
    halves = [make_found(item, (0.0, 0.48)), make_found(item, (0.52, 1.0))]
    scores = score(halves, [item])
    assert (scores.spans.required_found, scores.spans.false) == (0, 2)
    scores = score([make_found(item), make_found(item, shift=(0, 0.05, 0))], [item])
    assert (scores.spans.required_found, scores.spans.false) == (1, 1)
    assert scores.lateral_rmse.median == pytest.approx(0.0, abs=1e-9)


def test_hardly_seen_spans_need_not_be_found():
    """A conductor seen over half its length may be found or missed; it is never false."""
    conductors = make_conductors((0.0,))
    assert score([], conductors, seen=0.5).spans.required == 0
    scores = score([make_found(item) for item in conductors], conductors, seen=0.5)
    assert (scores.spans.required, scores.spans.found, scores.spans.false) == (0, 2, 0)


@pytest.mark.parametrize(('shifts', 'required', 'false'), [
    ((0.0, 0.0), 2, 0), ((0.2,), 1, 0), ((0.0, 0.2, 0.0), 2, 1),
])
def test_bundles_may_be_one_line_or_two(shifts, required, false):
    """A bundle is right as one line in its middle, or as both sub-conductors."""
    first, second = (make_conductors((0.0, 0.4), (0, 0))[i] for i in (0, 2))
    sources = [first, second] if len(shifts) == 2 else [first, first, second][:len(shifts)]
    found = [make_found(item, shift=(0.0, y, 0.0)) for item, y in zip(sources, shifts,
                                                                      strict=True)]
    scores = score(found, [first, second])
    assert scores.spans.required == scores.spans.required_found == required
    assert scores.spans.false == false
    assert scores.lateral_rmse.largest == pytest.approx(0.0, abs=1e-6)


def test_open_ends_are_compared_over_what_is_there():
    """The sag of an open-ended estimate is that of its part of the curve."""
    item = make_conductors((0.0,))[0]
    scores = score([make_found(item, (0.0, 0.7))], [item])
    assert scores.spans.required_found == 1
    assert scores.sag.median == pytest.approx(0.0, abs=1e-6)


def test_comparison_by_hand():
    """A level line 0.3 m higher that covers a quarter of the stretch."""
    low = Curve(line_id=0, span_id=0, start=np.zeros(3), end=np.array([100.0, 0, 0]), a=-1e6,
                b=50.0, c=1e6)
    high = Curve(line_id=0, span_id=0, start=np.array([25.0, 0, 0.3]),
                 end=np.array([50.0, 0, 0.3]), a=-1e6 + 0.3, b=25.0, c=1e6)
    result = compare(low, high, (0.0, 100.0), step=0.5, overhang=0.0)
    assert result.common == pytest.approx(51 / 201)
    assert result.vertical_rms == pytest.approx(0.3, abs=1e-6)
    assert result.lateral_rms == pytest.approx(0.0, abs=1e-9)


def test_wire_scores_by_hand():
    """3 right, 1 wrong, 2 missed: P 3/4, R 3/5, F1 2/3, IoU 1/2; empty ones are NaN."""
    scores = WireScores(true_positives=3, false_positives=1, false_negatives=2, left_out=0)
    assert (scores.precision, scores.recall) == (0.75, 0.6)
    assert scores.f1 == pytest.approx(2 / 3)
    assert scores.iou == 0.5
    empty = WireScores(true_positives=0, false_positives=0, false_negatives=0, left_out=0)
    assert np.isnan([empty.precision, empty.recall, empty.f1, empty.iou]).all()


def test_errors_against_numpy():
    """Quantiles and RMS are numpy's."""
    values = np.random.default_rng(0).uniform(0, 1, 37)
    errors = Errors(values=tuple(values.tolist()))
    assert errors.median == pytest.approx(np.median(values))
    assert errors.p95 == pytest.approx(np.quantile(values, 0.95))
    assert errors.rms == pytest.approx(np.sqrt(np.mean(values**2)))


def test_points_are_labelled_by_distance():
    """0.2 m off is wire, 0.4 m is left out, 2 m is not; attachments are left out."""
    item = make_conductors((0.0,))[0]
    middle = item.locate(np.array([30.0, 40.0, 50.0, 60.0, 0.5]))
    middle[:, 1] += [0.2, 0.4, 2.0, 0.0, 0.0]
    truth = parse_truth(make_content([item]))
    wire = np.array([True, True, True, False, True])
    scores = evaluate(make_survey([], middle, wire), truth).wire
    assert (scores.true_positives, scores.false_positives) == (1, 1)
    assert (scores.false_negatives, scores.left_out) == (1, 2)


def test_labels_of_a_cloud_are_used_by_order():
    """Class 14 is wire, class 0 is left out, all else is not; the numbers must agree."""
    labels = np.array([14, 14, 0, 2, 5], np.uint8)
    points = np.random.default_rng(0).normal(size=(5, 3))
    wire = np.array([True, False, True, False, True])
    truth = parse_truth(make_content([]), labels)
    scores = evaluate(make_survey([], points, wire), truth).wire
    assert (scores.true_positives, scores.false_positives) == (1, 1)
    assert (scores.false_negatives, scores.left_out) == (1, 1)
    with pytest.raises(DataError, match='hold 2 points, the labelled cloud 5'):
        evaluate(make_survey([]), truth)


HAZARD = {
    'kind': 'vegetation', 'line_id': 0, 'span_id': 0, 'position': [50.0, 1.0, 10.0],
    'clearance': 2.5, 'required': True, 'extent': [[49.0, 1.0, 6.0], [51.0, 3.0, 10.0]],
    'conductors': [{'line_id': 0, 'span_id': 0, 'clearance': 2.5}],
}


def _report(kind='vegetation', position=(50.0, 1.0, 10.0), clearance=2.4, span_id=0):
    return FoundHazard(kind=kind, line_id=0, span_id=span_id, position=np.array(position),
                       clearance=clearance)


@pytest.mark.parametrize(('reports', 'found', 'false', 'repeated', 'other'), [
    ([], 0, 0, 0, 0),
    ([_report()], 1, 0, 0, 0),
    ([_report(), _report(position=(50.5, 2.0, 7.0))], 1, 0, 1, 0),
    ([_report(position=(50.0, 1.0, 11.4))], 1, 0, 0, 0),
    ([_report(position=(50.0, 1.0, 11.6))], 0, 1, 0, 0),
    ([_report('ground')], 0, 0, 0, 1),
    ([_report(span_id=1)], 0, 1, 0, 0),
    ([_report('sag', (10.0, 0.0, 14.0))], 0, 1, 0, 0),
])
def test_hazards(reports, found, false, repeated, other):
    """A report counts by kind, place and span; a repeated one is counted apart."""
    conductors = make_conductors((0.0,))
    survey = make_survey([make_found(item) for item in conductors], hazards=reports)
    scores = evaluate(survey, parse_truth(make_content(conductors, hazards=[HAZARD])))
    assert (scores.hazards.required, scores.hazards.required_found) == (1, found)
    assert scores.hazards.false == false
    assert (scores.hazards_repeated, scores.hazards_of_other_kind) == (repeated, other)
    if found:
        assert scores.hazard_clearance.median == pytest.approx(0.1)


def test_hazards_too_close_to_call():
    """A hazard at the limit is neither missed nor false."""
    conductors = make_conductors((0.0,))
    content = make_content(conductors, hazards=[{**HAZARD, 'required': False}])
    found = [make_found(item) for item in conductors]
    silent = evaluate(make_survey(found), parse_truth(content)).hazards
    loud = evaluate(make_survey(found, hazards=[_report()]), parse_truth(content)).hazards
    assert (silent.required, silent.false, loud.required, loud.false) == (0, 0, 0, 0)
    assert loud.found == 1


@pytest.mark.parametrize(('seen', 'required'), [(0.0, 0), (0.5, 0), (0.6, 1), (1.0, 1)])
def test_low_conductors_that_were_hardly_seen_need_not_be_found(seen, required):
    """They may hang beyond the survey; all else in the truth was sampled."""
    conductors = make_conductors((0.0,))
    low = {**HAZARD, 'kind': 'ground', 'position': [50.0, 0.0, 10.0]}
    truth = parse_truth(make_content(conductors, seen=seen, hazards=[low, HAZARD]))
    assert evaluate(make_survey([]), truth).hazards.required == required + 1


def test_distance_to_vegetation():
    """The nearest point called vegetation is measured to the estimated curve."""
    item = make_conductors((0.0,))[0]
    content = make_content([item])
    content['spans'][0]['min_vegetation_distance'] = 3.0
    leaf = item.locate(np.array([40.0])) - [[0.0, 0.0, 3.1]]
    points = np.vstack([leaf, leaf - [[0, 0, 4.0]]])
    survey = replace(
        make_survey([make_found(item)], points), clearance=np.array([3.1, 7.1]),
        classification=np.full(2, PointClass.VEGETATION, np.uint8),
    )
    errors = evaluate(survey, parse_truth(content)).clearance
    assert errors.values == pytest.approx([0.1], abs=2e-3)


@pytest.fixture(scope='module')
def folder(tmp_path_factory):
    """Write the results of a run made by hand, and its truth."""
    base = tmp_path_factory.mktemp('evaluate')
    inspection = make_inspection(num_ground=2000)
    write_results(base / 'out', inspection)
    spans = [
        Conductor(line_id=item.line_id + 10, span_id=item.span_id, start=item.start,
                  end=item.end, c=item.c)
        for item in inspection.result.spans
    ]
    content = make_content(spans)
    content['supports'] = [
        {'position': item.position.tolist(), 'seen': True} for item in inspection.result.supports
    ]
    hazard = inspection.result.hazards[0]
    content['hazards'] = [{
        **HAZARD, 'clearance': hazard.clearance, 'extent': hazard.extent.tolist(),
        'conductors': [{'line_id': 10, 'span_id': 0, 'clearance': hazard.clearance}],
    }]
    (base / 'truth.json').write_text(json.dumps(content))
    labels = laspy.read(base / 'out' / 'points.laz')
    labels.write(base / 'labels.laz')
    return base


def test_command_prints_a_table(folder, capsys):
    """Files and memory give the same scores."""
    assert main([str(folder / 'out'), str(folder)]) == 0
    text = capsys.readouterr().out
    assert 'conductor-spans' in text
    assert '6 of 6 found, 0 false' in text
    inspection = make_inspection(num_ground=2000)
    survey = from_result(inspection.result, inspection.points)
    assert format_table(evaluate(survey, read_truth(folder / 'truth.json'))) == text.rstrip('\n')


@pytest.mark.parametrize(('order', 'scale', 'is_same'), [
    (1, 1.0, True), (1, 0.3048, True), (-1, 1.0, False),
])
def test_labels_of_points_in_another_order_are_refused(
    folder, tmp_path, capsys, order, scale, is_same
):
    """A file in another unit, which the results may be converted from, holds the same points."""
    las = laspy.read(folder / 'labels.laz')
    places = las.xyz[::order] / scale
    las.classification = las.classification[::order]
    las.x, las.y, las.z = places.T
    las.write(tmp_path / 'labels.laz')
    assert main([str(folder / 'out'), str(tmp_path / 'labels.laz')]) == (0 if is_same else 2)
    out, err = capsys.readouterr()
    assert ('F1 1.0000' in out) == is_same
    assert ('or in another order: point' in err) != is_same


def test_command_prints_json(folder, capsys):
    """--json is strict JSON with the same numbers."""
    assert main([str(folder / 'out'), str(folder / 'truth.json'), '--json']) == 0
    scores = json.loads(capsys.readouterr().out)
    assert scores['spans']['required_found'] == 6
    assert scores['hazards']['required_found'] == 1
    assert scores['wire']['f1'] > 0.98
    assert scores['sag']['median'] < 0.001


def test_command_with_a_labelled_cloud(folder, capsys):
    """A labelled cloud gives wire scores and nothing else."""
    assert main([str(folder / 'out'), str(folder / 'labels.laz'), '--json']) == 0
    scores = json.loads(capsys.readouterr().out)
    assert (scores['wire']['f1'], scores['wire']['left_out']) == (1.0, 0)
    assert 'spans' not in scores


@pytest.mark.parametrize('case', ['results', 'truth', 'json', 'keys', 'laz', 'points', 'list'])
def test_bad_input_is_one_line(folder, case, capsys, tmp_path):
    """Missing or malformed input: status 2 and one line on stderr."""
    out, truth = folder / 'out', folder / 'truth.json'
    bad = tmp_path / ('bad.laz' if case == 'laz' else 'bad.json')
    if case == 'results':
        out = tmp_path / 'nothing'
    elif case == 'truth':
        truth = tmp_path / 'nothing.json'
    elif case == 'points':
        out = tmp_path / 'out'
        out.mkdir()
        for name in ('spans.json', 'supports.json', 'hazards.json'):
            (out / name).write_bytes((folder / 'out' / name).read_bytes())
        whole = (folder / 'out' / 'points.laz').read_bytes()
        (out / 'points.laz').write_bytes(whole[:len(whole) // 2])
    else:
        truth = bad
        content = {'json': '{"spans": [', 'keys': '{"spans": [{}]}', 'list': '[]'}
        if case == 'laz':
            bad.write_bytes((folder / 'labels.laz').read_bytes()[:3000])
        else:
            bad.write_text(content[case])
    assert main([str(out), str(truth)]) == 2
    assert len(capsys.readouterr().err.strip().splitlines()) == 1


def test_results_of_another_cloud_raise():
    """A result and a cloud of different size do not belong together."""
    inspection = make_inspection(num_ground=200)
    with pytest.raises(DataError, match='for a cloud of 5'):
        from_result(inspection.result, inspection.points[:5])


def test_read_survey_keeps_everything(folder):
    """All spans, supports, hazards and points of the folder are there."""
    survey = read_survey(folder / 'out')
    assert (len(survey.spans), len(survey.supports), len(survey.hazards)) == (6, 3, 1)
    assert len(survey.points) == len(survey.classification) == len(survey.clearance)
    assert to_mapping(evaluate(survey, read_truth(folder)))['num_lines'] == 3


@pytest.mark.parametrize('units', [(0.3048, 0.3048), (1200.0 / 3937.0, 1.0)])
def test_results_in_feet_score_as_in_metres(folder, tmp_path, units):
    """The truth is in metres, and so are all limits."""
    horizontal, vertical = units
    write_results(tmp_path / 'out', make_inspection(
        num_ground=2000, units=Units(horizontal=horizontal, vertical=vertical)
    ))
    truth = read_truth(folder)
    feet, metres = (
        evaluate(read_survey(base / 'out'), truth) for base in (tmp_path, folder)
    )
    assert (feet.spans, feet.supports) == (metres.spans, metres.supports)
    assert (feet.hazards, feet.wire) == (metres.hazards, metres.wire)
    assert feet.sag.values == pytest.approx(metres.sag.values)


@pytest.mark.parametrize(('part', 'key', 'value'), [
    ('spans', 'line_id', math.inf), ('spans', 'min_vegetation_distance', 'near'),
    ('spans', 'sag', math.nan), ('spans', 'seen', math.nan),
    ('supports', 'position', [0.0, math.nan, 0.0]),
    ('hazards', 'extent', [[0.0] * 3, [math.inf] * 3]),
])
def test_a_truth_with_what_is_no_number_is_refused(folder, part, key, value):
    """It would be missed, or not required, without a word."""
    content = json.loads((folder / 'truth.json').read_text())
    content[part][0][key] = value
    with pytest.raises(DataError, match='cannot be read'):
        parse_truth(content)


def test_reports_in_boxes_that_overlap_belong_to_the_nearest_place():
    """Two trees whose boxes overlap, each reported: none is missed, none is repeated."""
    conductors = make_conductors((0.0,))
    truth = [{**HAZARD, 'position': [x, 1.0, 11.0], 'extent': [[20, 0, 5], [40, 3, 12]]}
             for x in (22.0, 38.0)]
    reports = [_report(position=np.array(item['position'])) for item in truth]
    survey = make_survey([make_found(item) for item in conductors], hazards=reports)
    scores = evaluate(survey, parse_truth(make_content(conductors, hazards=truth)))
    assert (scores.hazards.required, scores.hazards.required_found) == (2, 2)
    assert scores.hazards_repeated == 0


@pytest.mark.parametrize('command', [
    'plc_inspect.sim.evaluation.evaluate', 'plc_inspect.sim.simulate',
])
def test_bad_usage_is_one_line(command, capsys):
    """As of all commands."""
    with pytest.raises(SystemExit) as end:
        importlib.import_module(command).main(['--nothing'])
    assert end.value.code == 2
    assert len(capsys.readouterr().err.splitlines()) == 1


def test_a_reader_of_the_scores_may_leave(folder):
    """As ``head`` does."""
    call = 'import sys; from plc_inspect.sim.evaluation.evaluate import main; sys.exit(main())'
    with subprocess.Popen(
        [sys.executable, '-c', call, str(folder / 'out'), str(folder)],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE,
    ) as process:
        process.stdout.close()
        assert process.stderr.read() == b''
    assert process.returncode == 0
