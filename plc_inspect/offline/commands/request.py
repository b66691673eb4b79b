# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Requests of a command besides the results: rules, load cases, comparison."""

import argparse
import dataclasses
from dataclasses import dataclass
import hashlib
import math
from pathlib import Path
from typing import Any

from plc_inspect.config import Settings
from plc_inspect.core.hazards.clearance_rules import RuleSet
from plc_inspect.core.loads.contact import find_contacts
from plc_inspect.core.loads.load_cases import evaluate_cases, SURVEYED
from plc_inspect.core.loads.sag_tension import Case, Conductor
from plc_inspect.errors import ConfigError
from plc_inspect.offline.commands.command_line import Progress
from plc_inspect.offline.export.results_folder import write_results
from plc_inspect.offline.readers.catalogue import load_conductor, load_rules, parse_case
from plc_inspect.offline.records.changes import find_changes, read_survey, Survey, to_survey
from plc_inspect.offline.records.georeference import make_origin_crs, require_horizontal
from plc_inspect.offline.records.inspection import Inspection
from plc_inspect.offline.report.paper import check_printing
from plc_inspect.setting_names import update


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Request:
    """A validated request; all errors are found before the pipeline runs."""

    rules: RuleSet
    cases: tuple[Case, ...] = ()
    conductor: Conductor | None = None
    temperature: float = 0.0
    """Temperature of the conductor when surveyed [degrees Celsius]; used with cases only."""
    baseline: Survey | None = None
    geo: bool = False
    """Files for geographic information systems are required."""
    paper: str = ''
    """Paper size of the printed report, '' for none."""


def read_request(
    arguments: argparse.Namespace, settings: Settings
) -> tuple[Request, Settings]:
    """
    Read the request from the arguments of `make_parser`.

    Parameters
    ----------
    arguments : Namespace
        Of the command.
    settings : Settings
        From files and assignments; ``--rules`` and ``--voltage`` win over them.

    Returns
    -------
    tuple of Request and Settings

    Raises
    ------
    ConfigError
        A rule set, conductor or case is unknown or contradictory, or something is missing.
    DataError
        The baseline cannot be read.

    """
    changes = {'hazards.rules': arguments.rules, 'hazards.voltage': arguments.voltage}
    settings = update(settings, {name: item for name, item in changes.items() if item is not None})
    rules = load_rules(settings.hazards)
    cases = tuple(parse_case(text) for text in arguments.cases)
    names = [SURVEYED, *(case.name for case in cases)]
    if len(set(names)) < len(names):
        raise ConfigError(
            f'names of cases must differ, also from {SURVEYED!r}, got {", ".join(names[1:])}'
        )
    conductor = None
    if cases:
        if arguments.conductor is None:
            raise ConfigError('--case needs --conductor: the change of state depends on it')
        if arguments.surveyed_at is None:
            raise ConfigError(
                '--case needs --surveyed-at: the temperature of a conductor is not measured'
            )
        conductor = load_conductor(arguments.conductor, arguments.conductors)
        Case(name='--surveyed-at', temperature=arguments.surveyed_at)
    if arguments.pdf:
        check_printing(arguments.paper)
    return Request(
        rules=rules, cases=cases, conductor=conductor, temperature=arguments.surveyed_at or 0.0,
        baseline=read_survey(arguments.baseline) if arguments.baseline else None,
        geo=arguments.geo, paper=arguments.paper if arguments.pdf else '',
    ), settings


def complete(inspection: Inspection, request: Request) -> Inspection:
    """
    Add the requested parts to a run.

    Parameters
    ----------
    inspection : Inspection
        The run.
    request : Request
        The request.

    Returns
    -------
    Inspection

    Raises
    ------
    ConfigError
        Files for geographic information systems are required and the CRS is unknown.
    DataError
        A case has no state, or the surveys do not overlap.

    """
    inspection = dataclasses.replace(inspection, rules=request.rules)
    if request.geo:
        require_horizontal(inspection.source, inspection.crs or inspection.georeference)
    settings = inspection.settings.hazards
    if request.cases and request.conductor is not None:
        what_if = evaluate_cases(
            inspection.points, inspection.result, request.conductor, request.temperature,
            request.cases, request.rules, settings.min_points,
        )
        contacts = find_contacts(
            inspection.points, inspection.result, request.conductor, request.temperature,
            request.rules,
        )
        what_if = dataclasses.replace(what_if, contacts=contacts)
        inspection = dataclasses.replace(inspection, what_if=what_if)
    if request.baseline is not None:
        changes = find_changes(request.baseline, to_survey(inspection), settings.sag_deviation)
        inspection = dataclasses.replace(inspection, changes=changes)
    return inspection


def deliver(
    inspection: Inspection, request: Request, arguments: argparse.Namespace, progress: Progress
) -> Inspection:
    """
    Add the requested parts to a run, and write its results folder.

    Parameters
    ----------
    inspection : Inspection
        The run.
    request : Request
        The request.
    arguments : Namespace
        Of the command; ``output`` and ``force`` are read.
    progress : callable
        Called with the name of the step and its share.

    Returns
    -------
    Inspection
        The run as written.

    Raises
    ------
    ConfigError
        See `complete`; or the folder cannot be written.
    DataError
        See `complete`.

    """
    inspection = complete(inspection, request)
    progress('writing', 0.0)
    write_results(arguments.output, inspection, arguments.force, request.paper)
    return inspection


def locate_flight(text: str | None) -> dict[str, Any]:
    """
    Read the origin of a flight.

    Parameters
    ----------
    text : str or None
        Latitude, longitude and altitude, as ``59.33,18.07,25``.

    Returns
    -------
    dict
        ``georeference`` and ``altitude`` of Inspection; empty without an origin.

    Raises
    ------
    ConfigError
        The text is malformed, or out of range.

    """
    if text is None:
        return {}
    try:
        latitude, longitude, altitude = (float(part) for part in text.split(','))
    except ValueError:
        raise ConfigError(f'--origin must be LAT,LON,ALT, got {text!r}') from None
    if not math.isfinite(altitude):
        raise ConfigError(f'--origin must have a finite altitude, got {altitude!r}')
    return {'georeference': make_origin_crs(latitude, longitude), 'altitude': altitude}


def hash_input(path: Path) -> str:
    """Return the SHA-256 of a file, or of all files of a folder in order of their names."""
    digest = hashlib.sha256()
    files = sorted(item for item in path.rglob('*') if item.is_file()) if path.is_dir() else [path]
    for item in files:
        with item.open('rb') as stream:
            while block := stream.read(1 << 20):
                digest.update(block)
    return digest.hexdigest()
