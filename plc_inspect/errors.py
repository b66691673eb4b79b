# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Exceptions of the package."""


class PlcInspectError(Exception):
    """Base of all errors that plc_inspect raises on purpose."""


class ConfigError(PlcInspectError):
    """A setting is unknown, of the wrong type or out of its range."""


class DataError(PlcInspectError):
    """Input data is missing, malformed or contradictory."""


class FitError(PlcInspectError):
    """A model cannot be fitted to the given points."""


def explain_missing(error: ModuleNotFoundError) -> str:
    """Return one line that names the missing Python package and how to install it."""
    package = (error.name or str(error)).partition('.')[0]
    return f'the Python package {package} is missing: install it as docs/install.md says'


def say_needed(path: object, error: ModuleNotFoundError) -> DataError:
    """Return the error of an input whose format needs a package that is missing."""
    package = (error.name or str(error)).partition('.')[0]
    return DataError(
        f'{path} needs the Python package {package}, which is missing: '
        "pip install 'plc_inspect[formats]'"
    )
