# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""HTML templates of the report and of the page of the monitor."""

import jinja2


def open_templates(folder: str) -> jinja2.Environment:
    """
    Return the environment of a folder of templates.

    Texts are escaped, and an undefined name is an error.

    Parameters
    ----------
    folder : str
        Below ``plc_inspect``, as ``monitor/page``.

    """
    return jinja2.Environment(
        loader=jinja2.PackageLoader('plc_inspect', folder),
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=jinja2.StrictUndefined,
    )
