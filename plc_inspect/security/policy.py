# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
Access control: the SROS2 policy, and the documents that DDS Security needs.

``config/security/policy.xml`` is in the format of ``ros2 security create_permission``.  Its names
are converted to DDS names as rmw does: prefix ``rt`` for topics, ``rq`` and ``rr`` for services.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from xml.etree import ElementTree

from plc_inspect.errors import ConfigError
from plc_inspect.security.xml_document import add_text, write

SCHEMA = 'http://www.omg.org/spec/DDS-SECURITY/20170901/omg_shared_ca_{}.xsd'
SCHEMA_INSTANCE = 'http://www.w3.org/2001/XMLSchema-instance'
DISCOVERY = 'ros_discovery_info'
"""Topic by which ROS participants announce their nodes; all need it."""
LARGEST_POLICY = 1_000_000
"""Greatest size of a policy file [bytes]."""


@dataclass(frozen=True, slots=True)
class Rights:
    """Names of DDS topics, sorted."""

    publish: tuple[str, ...]
    subscribe: tuple[str, ...]


def read_policy(path: Path) -> dict[str, Rights]:
    """
    Read a policy.

    Parameters
    ----------
    path : Path
        XML in the format of SROS2, version 0.2.0, without includes.

    Returns
    -------
    dict of str to Rights
        Rights by path of the enclave.

    Raises
    ------
    ConfigError
        It cannot be read, or holds unknown elements: rights are never guessed.

    """
    try:
        data = path.read_bytes()
        if len(data) > LARGEST_POLICY or b'<!' in data.replace(b'<!--', b''):
            raise ConfigError(f'{path}: a policy is small and has no document type')
        root = ElementTree.fromstring(data)  # nosec B314
    except (OSError, ElementTree.ParseError) as error:
        raise ConfigError(f'{path} cannot be read: {error}') from error
    if root.tag != 'policy' or root.get('version') != '0.2.0':
        raise ConfigError(f'{path} is not an SROS2 policy of version 0.2.0')
    enclaves = root.findall('enclaves/enclave')
    return {enclave.get('path', ''): _read_rights(enclave, path) for enclave in enclaves}


def make_permissions(
    enclave: str, rights: Rights, domain: int, begin: datetime, end: datetime
) -> str:
    """Return the permissions of an enclave for a domain, as XML; the default is deny."""
    root = _document('permissions')
    grant = ElementTree.SubElement(
        ElementTree.SubElement(root, 'permissions'), 'grant', name=enclave
    )
    add_text(grant, 'subject_name', f'CN={enclave}')
    validity = ElementTree.SubElement(grant, 'validity')
    add_text(validity, 'not_before', begin.strftime('%Y-%m-%dT%H:%M:%S'))
    add_text(validity, 'not_after', end.strftime('%Y-%m-%dT%H:%M:%S'))
    rule = ElementTree.SubElement(grant, 'allow_rule')
    add_text(ElementTree.SubElement(rule, 'domains'), 'id', str(domain))
    for kind in ('publish', 'subscribe'):
        topics = ElementTree.SubElement(ElementTree.SubElement(rule, kind), 'topics')
        for name in getattr(rights, kind):
            add_text(topics, 'topic', name)
    add_text(grant, 'default', 'DENY')
    return write(root)


def make_governance(domain: int) -> str:
    """Return the governance of a domain, as XML: no unknown participants, all is encrypted."""
    root = _document('governance')
    rule = ElementTree.SubElement(
        ElementTree.SubElement(root, 'domain_access_rules'), 'domain_rule'
    )
    add_text(ElementTree.SubElement(rule, 'domains'), 'id', str(domain))
    _fill(rule, {
        'allow_unauthenticated_participants': 'false', 'enable_join_access_control': 'true',
        'discovery_protection_kind': 'ENCRYPT', 'liveliness_protection_kind': 'ENCRYPT',
        'rtps_protection_kind': 'ENCRYPT',
    })
    rules = ElementTree.SubElement(rule, 'topic_access_rules')
    _fill(ElementTree.SubElement(rules, 'topic_rule'), {
        'topic_expression': '*', 'enable_discovery_protection': 'true',
        'enable_liveliness_protection': 'true', 'enable_read_access_control': 'true',
        'enable_write_access_control': 'true', 'metadata_protection_kind': 'ENCRYPT',
        'data_protection_kind': 'ENCRYPT',
    })
    return write(root)


def _read_rights(enclave: ElementTree.Element, path: Path) -> Rights:
    publish, subscribe = {DISCOVERY}, {DISCOVERY}
    for profile in enclave.findall('profiles/profile'):
        space, node = profile.get('ns', '/').rstrip('/'), profile.get('node', '')
        for group in profile:
            names = [_resolve((item.text or '').strip(), space, node) for item in group]
            if not all(names) or set(group.attrib.values()) != {'ALLOW'}:
                raise ConfigError(f'{path}: {group.tag} of {node} names nothing or is not ALLOW')
            for kind in group.attrib:
                if (group.tag, kind) in (('topics', 'publish'), ('topics', 'subscribe')):
                    own = publish if kind == 'publish' else subscribe
                    own.update(f'rt{name}' for name in names)
                elif (group.tag, kind) in (('services', 'reply'), ('services', 'request')):
                    asks, answers = (
                        (publish, subscribe) if kind == 'request' else (subscribe, publish)
                    )
                    asks.update(f'rq{name}Request' for name in names)
                    answers.update(f'rr{name}Reply' for name in names)
                else:
                    raise ConfigError(f'{path}: {kind} of {group.tag} is not understood')
    return Rights(tuple(sorted(publish)), tuple(sorted(subscribe)))


def _resolve(name: str, space: str, node: str) -> str:
    """Return the full name of a topic or service, '' for none."""
    if not name or '*' in name:
        return ''
    if name.startswith('/'):
        return name
    if name.startswith('~'):
        return f'{space}/{node}/{name[1:].lstrip("/")}'
    return f'{space}/{name}'


def _document(kind: str) -> ElementTree.Element:
    return ElementTree.Element('dds', {
        'xmlns:xsi': SCHEMA_INSTANCE, 'xsi:noNamespaceSchemaLocation': SCHEMA.format(kind),
    })


def _fill(parent: ElementTree.Element, values: Mapping[str, str]) -> None:
    for name, value in values.items():
        add_text(parent, name, value)
