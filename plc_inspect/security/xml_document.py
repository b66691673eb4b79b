# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""XML as Fast DDS and DDS Security read it."""

from xml.etree import ElementTree


def add_text(parent: ElementTree.Element, name: str, value: object) -> None:
    """Put an element with a text below another one."""
    ElementTree.SubElement(parent, name).text = str(value)


def write(root: ElementTree.Element) -> str:
    """Return a document, indented."""
    ElementTree.indent(root)
    head = '<?xml version="1.0" encoding="UTF-8"?>\n'
    return head + ElementTree.tostring(root, encoding='unicode') + '\n'
