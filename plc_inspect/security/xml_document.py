# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""XML documents for Fast DDS and DDS Security."""

from xml.etree import ElementTree


def add_text(parent: ElementTree.Element, name: str, value: object) -> None:
    """Append an element with a text to another one."""
    ElementTree.SubElement(parent, name).text = str(value)


def write(root: ElementTree.Element) -> str:
    """Return the indented document as text."""
    ElementTree.indent(root)
    head = '<?xml version="1.0" encoding="UTF-8"?>\n'
    return head + ElementTree.tostring(root, encoding='unicode') + '\n'
