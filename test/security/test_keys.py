# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Keys of a fleet: openssl and cryptography agree on them, and each member has its rights only."""

from datetime import datetime, timedelta, UTC
import json
from pathlib import Path
import re
import shutil
import stat
import subprocess
from xml.etree import ElementTree

from cryptography import x509
import pytest

from plc_inspect.errors import ConfigError
from plc_inspect.security.authority import (
    find_end,
    issue,
    load_credential,
    make_authority,
    read_end,
)
from plc_inspect.security.command import main
from plc_inspect.security.graph_profile import make_profile, Place, read_place, read_port
from plc_inspect.security.keyring import Keyring, ROLES
from plc_inspect.security.policy import DISCOVERY, read_policy
from plc_inspect.stream.signature import Signer, split_keys, Verifier

ROOT = Path(__file__).parents[2]
POLICY = ROOT / 'config/security/policy.xml'
BEGIN = datetime(2026, 1, 1, 12, tzinfo=UTC)
NAMESPACE = '{http://www.eprosima.com}'
BARE = {
    'velodyne_points', 'odometry', 'tf', 'tf_static', 'clock', 'diagnostics', 'rosout',
    'parameter_events',
}
"""Topics that are not below the node's name."""


@pytest.fixture(scope='module')
def keys(tmp_path_factory):
    """Make keys, add a second vehicle, and take the logger's back."""
    folder = tmp_path_factory.mktemp('keys') / 'keys'
    assert main(['create', str(folder), '--domain', '5', '--page', '10.0.0.2']) == 0
    assert main(['add', str(folder), 'second', '--role', 'vehicle']) == 0
    shutil.copytree(folder, folder.with_name('before'))
    assert main(['revoke', str(folder), 'logger']) == 0
    return folder


@pytest.fixture(scope='module')
def openssl():
    """Return a function that runs openssl, and tells whether it was content."""
    program = shutil.which('openssl')
    if program is None:
        pytest.skip('openssl is not installed')

    def run(*arguments):
        done = subprocess.run([program, *map(str, arguments)], capture_output=True, check=False)
        return done.returncode == 0, (done.stdout + done.stderr).decode()

    return run


def enclave_of(keys, name):
    """Return the folder of a member's enclave; the logger's as it was before it was taken back."""
    if not (keys / name).is_dir():
        keys = keys.with_name('before')
    return keys / name / 'sros2/enclaves/plc_inspect' / name


def read_table():
    """Return the rights of docs/security.md, as sets of DDS topics by role."""
    text = (ROOT / 'docs/security.md').read_text(encoding='utf-8')
    body = text.partition('| enclave | publishes')[2].partition('\n\n')[0]
    rights = {}
    for row in re.findall(r'^\| ([a-z]+) \|(.*)\|$', body, re.MULTILINE):
        cells = [cell.split() for cell in row[1].split('|')]
        topics = [
            {('rt/' if name in BARE else 'rt/plc_inspect/') + name for name in cell}
            for cell in cells[:2]
        ]
        asked, answered = (
            [{f'{kind}/plc_inspect/{name}{end}' for name in cell} for cell in cells[2:]]
            for kind, end in (('rq', 'Request'), ('rr', 'Reply'))
        )
        own = {DISCOVERY, 'rt/parameter_events'}
        rights[row[0]] = (
            topics[0] | own | asked[1] | answered[0],
            topics[1] | {DISCOVERY} | asked[0] | answered[1],
        )
    return rights


def test_each_enclave_has_exactly_the_rights_of_the_table(keys):
    table = read_table()
    assert set(table) == set(ROLES)
    for role in ROLES:
        signed = (enclave_of(keys, role) / 'permissions.p7s').read_text(encoding='utf-8')
        (document,) = re.findall(r'<\?xml.*?</dds>', signed, re.DOTALL)
        (grant,) = ElementTree.fromstring(document.replace('\r', '')).iter('grant')
        assert grant.findtext('subject_name') == f'CN=/plc_inspect/{role}'
        assert grant.findtext('default') == 'DENY'
        (rule,) = grant.findall('allow_rule')
        assert [item.text for item in rule.findall('domains/id')] == ['5']
        found = [
            {item.text for item in rule.findall(f'{kind}/topics/topic')}
            for kind in ('publish', 'subscribe')
        ]
        assert found == list(table[role]), role
    assert 'rq/plc_inspect/resetRequest' not in table['ground'][0]
    assert 'rq/plc_inspect/saveRequest' in table['ground'][0]
    assert 'rq/plc_inspect/resetRequest' in table['operator'][0]
    given = set.union(*(table[role][0] for role in ROLES))
    inputs = {name for name in table['vehicle'][1] if name.startswith('rt/')}
    assert inputs - given == {'rt/clock'}  # each has somebody who may send it
    assert [role for role in ROLES if 'rt/velodyne_points' in table[role][0]] == ['driver']


def test_openssl_verifies_the_keystore(keys, openssl):
    for role in set(ROLES) - {'logger'} | {'second'}:
        folder = enclave_of(keys, role)
        for name in ('permissions', 'governance'):
            good, text = openssl(
                'smime', '-verify', '-text', '-in', folder / f'{name}.p7s', '-CAfile',
                folder / 'permissions_ca.cert.pem',
            )
            assert good, text
            place = folder if name == 'permissions' else folder.parents[1]
            xml = (place / f'{name}.xml').read_text(encoding='utf-8')
            assert xml.strip() in text.replace('\r', '')
        good, text = openssl(
            'verify', '-crl_check', '-CRLfile', folder / 'crl.pem', '-CAfile',
            folder / 'identity_ca.cert.pem', folder / 'cert.pem',
        )
        assert good, text
        good, text = openssl('verify', '-x509_strict', '-crl_check', '-CRLfile',
                             keys / role / 'crl.pem', '-CAfile', keys / role / 'root_ca.crt',
                             keys / role / 'member.crt')
        assert good, text


def test_a_changed_document_does_not_verify(keys, openssl, tmp_path):
    folder = enclave_of(keys, 'ground')
    signed = (folder / 'permissions.p7s').read_bytes()
    changed = tmp_path / 'permissions.p7s'
    changed.write_bytes(signed.replace(b'saveRequest', b'resetRequest'))
    assert changed.read_bytes() != signed
    good, _ = openssl('smime', '-verify', '-text', '-in', changed, '-CAfile',
                      folder / 'permissions_ca.cert.pem')
    assert not good


def test_what_is_revoked_is_on_the_list(keys, openssl):
    before = keys.with_name('before')
    assert not (keys / 'logger').exists()
    old = enclave_of(before, 'logger') / 'cert.pem'
    ca = keys / 'ground/root_ca.crt'
    assert openssl('verify', '-CAfile', ca, old)[0]
    good, text = openssl('verify', '-crl_check', '-CRLfile',
                         enclave_of(keys, 'ground') / 'crl.pem', '-CAfile', ca, old)
    assert not good
    assert 'revoked' in text
    assert [item['name'] for item in json.loads((keys / 'register.json').read_text())['members']
            if item['revoked']] == ['logger']


def test_private_keys_are_private_and_stay_at_home(keys):
    for path in keys.rglob('*'):
        secret = path.name.endswith(('.key', 'key.pem')) or path.name == 'register.json'
        if path.is_file() and secret:
            assert stat.S_IMODE(path.stat().st_mode) == 0o600, path
    assert stat.S_IMODE((keys / 'authority').stat().st_mode) == 0o700
    authority = {(keys / 'authority/root.key').read_bytes()}
    for role in ROLES:
        for path in (keys / role).rglob('*'):
            assert not path.is_symlink()
            assert path.is_dir() or path.read_bytes() not in authority
    # Only vehicles sign the stream, each with a key of its own; all others can check both.
    streams = sorted(keys.rglob('stream.key'))
    assert [path.parent.name for path in streams] == ['second', 'vehicle']
    assert streams[0].read_bytes() != streams[1].read_bytes()
    announced = split_keys((keys / 'ground/stream.pub').read_bytes())
    assert len(announced) == 4  # of each the one that signs, and the one that comes next


def test_the_page_has_its_names(keys):
    certificate = x509.load_pem_x509_certificate((keys / 'ground/member.crt').read_bytes())
    names = certificate.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    assert [str(item) for item in names.get_values_for_type(x509.IPAddress)] == [
        '127.0.0.1', '10.0.0.2',
    ]
    assert names.get_values_for_type(x509.DNSName) == ['localhost']
    driver = x509.load_pem_x509_certificate((keys / 'driver/member.crt').read_bytes())
    with pytest.raises(x509.ExtensionNotFound):
        driver.extensions.get_extension_for_class(x509.SubjectAlternativeName)


def test_certificates_end(openssl, tmp_path):
    then = datetime.now(UTC) - timedelta(days=30)
    authority = make_authority('a', 100, then)
    (tmp_path / 'ca').write_bytes(authority.pem)
    for days, good in ((29, False), (31, True)):
        own = issue(authority, 'b', days, (), then)
        (tmp_path / 'own').write_bytes(own.pem)
        assert openssl('verify', '-CAfile', tmp_path / 'ca', tmp_path / 'own')[0] == good
        assert abs(read_end(own.pem) - then - timedelta(days=days)) < timedelta(seconds=2)
    with pytest.raises(ConfigError, match='1 to 3650 days, not 0'):
        issue(authority, 'b', 0)
    with pytest.raises(ConfigError, match='do not belong together'):
        load_credential(own.key_pem, authority.pem)


def test_a_revoked_name_can_be_given_again(tmp_path, openssl):
    policy = read_policy(POLICY)
    keyring = Keyring(tmp_path / 'keys', policy)
    first = keyring.create(domain=0, days=10, hosts=())
    stolen = (enclave_of(keyring.folder, 'vehicle') / 'cert.pem').read_bytes()
    keyring.revoke('vehicle')
    again = keyring.add('vehicle', 'vehicle')
    assert not again.members['vehicle'].revoked
    assert again.old_serials == (first.members['vehicle'].serial,)
    assert keyring.load() == again
    (tmp_path / 'stolen').write_bytes(stolen)
    for path, good in ((tmp_path / 'stolen', False),
                       (enclave_of(keyring.folder, 'vehicle') / 'cert.pem', True)):
        crl = enclave_of(keyring.folder, 'ground') / 'crl.pem'
        assert openssl('verify', '-crl_check', '-CRLfile', crl, '-CAfile',
                       keyring.folder / 'ground/root_ca.crt', path)[0] == good


def test_all_certificates_of_a_revoked_member_are_on_the_list(tmp_path, openssl):
    keyring = Keyring(tmp_path / 'keys', read_policy(POLICY))
    keyring.create(domain=0, days=10, hosts=())
    held = []
    for _ in range(3):
        held.append((enclave_of(keyring.folder, 'vehicle') / 'cert.pem').read_bytes())
        keyring.renew()
    keyring.revoke('vehicle')
    for again in (False, True):
        if again:
            keyring.add('vehicle', 'vehicle')
        for number, pem in enumerate(held):
            path = tmp_path / f'{number}.pem'
            path.write_bytes(pem)
            good, text = openssl(
                'verify', '-crl_check', '-CRLfile',
                enclave_of(keyring.folder, 'ground') / 'crl.pem', '-CAfile',
                keyring.folder / 'ground/root_ca.crt', path,
            )
            assert not good
            assert 'revoked' in text


DAYS = 30
RENEWALS = (28, 55, 84, 112, 141)
"""Days of renewals, each before the certificates of the one before end."""


@pytest.fixture(scope='module')
def generations(tmp_path_factory):
    """Return the days of all renewals with all members' folders as of then."""
    folder, found = tmp_path_factory.mktemp('renewed'), []
    keyring = Keyring(folder / 'keys', read_policy(POLICY))
    for number, day in enumerate((0, *RENEWALS)):
        now = BEGIN + timedelta(days=day)
        if number:
            keyring.renew(now)
        else:
            keyring.create(domain=0, days=DAYS, hosts=(), now=now)
        shutil.copytree(keyring.folder, folder / str(number))
        found.append((now, folder / str(number)))
    return found


@pytest.mark.parametrize('number', range(len(RENEWALS)))
def test_members_understand_each_other_while_a_renewal_is_under_way(
    generations, openssl, number
):
    (_, before), (now, after) = generations[number:number + 2]
    for own, other in ((before, after), (after, before), (after, after)):
        end = read_end((other / 'vehicle/member.crt').read_bytes())
        for when in (now + timedelta(minutes=1), end - timedelta(minutes=1)):
            good, text = openssl(
                'verify', '-x509_strict', '-attime', int(when.timestamp()), '-crl_check',
                '-CRLfile', own / 'ground/crl.pem', '-CAfile', own / 'ground/root_ca.crt',
                other / 'vehicle/member.crt',
            )
            assert good, text
        for name in ('permissions', 'governance'):  # as Fast DDS verifies them
            good, text = openssl(
                'smime', '-verify', '-text', '-nointern', '-noverify', '-certfile',
                enclave_of(own, 'ground') / 'permissions_ca.cert.pem', '-in',
                enclave_of(other, 'vehicle') / f'{name}.p7s',
            )
            assert good, text
        verifier = Verifier((own / 'ground/stream.pub').read_bytes())
        signer = Signer((other / 'vehicle/stream.key').read_bytes(), 1)
        assert verifier.check(signer.sign(bytes(30))) is not None


def test_nothing_outlives_the_root_and_keys_are_taken_back(generations):
    for now, folder in generations:
        roots = x509.load_pem_x509_certificates((folder / 'ground/root_ca.crt').read_bytes())
        ends = [find_end(item) for item in roots]
        assert len(roots) <= 3
        assert ends == sorted(ends, reverse=True)
        assert min(ends) > now
        assert ends[0] > read_end((folder / 'ground/member.crt').read_bytes())
        for path in folder.rglob('*_ca.cert.pem'):
            assert path.read_bytes() == (folder / 'ground/root_ca.crt').read_bytes()
    keys = [(folder / 'vehicle/stream.key').read_bytes() for _, folder in generations]
    assert len(set(keys)) == len(keys)
    for number, (_, folder) in enumerate(generations):
        verifier = Verifier((folder / 'ground/stream.pub').read_bytes())
        known = [verifier.check(Signer(key, 1).sign(bytes(30))) is not None for key in keys]
        assert known == [abs(number - other) <= 1 for other in range(len(keys))]


def test_a_member_that_is_added_late_does_not_outlive_the_root(tmp_path, openssl):
    keyring = Keyring(tmp_path / 'keys', read_policy(POLICY))
    keyring.create(domain=0, days=DAYS, hosts=(), now=BEGIN)
    late = BEGIN + timedelta(days=29)
    keyring.add('second', 'vehicle', late)
    good, text = openssl(
        'verify', '-attime', int(late.timestamp()) + 86_400 * (DAYS - 1), '-CAfile',
        keyring.folder / 'ground/root_ca.crt', keyring.folder / 'second/member.crt',
    )
    assert good, text


def test_a_keyring_that_announced_no_keys_goes_on_with_those_it_has(tmp_path):
    keyring = Keyring(tmp_path / 'keys', read_policy(POLICY))
    keyring.create(domain=0, days=DAYS, hosts=())
    shutil.rmtree(keyring.folder / 'authority/streams')
    old = (keyring.folder / 'vehicle/stream.key').read_bytes()
    keyring.revoke('logger')
    public = (keyring.folder / 'ground/stream.pub').read_bytes()
    assert len(split_keys(public)) == 1
    keyring.renew()
    assert (keyring.folder / 'vehicle/stream.key').read_bytes() == old
    assert len(split_keys((keyring.folder / 'ground/stream.pub').read_bytes())) == 2


def test_folders_that_were_moved_away_are_in_nobodys_way(tmp_path):
    keyring = Keyring(tmp_path / 'keys', read_policy(POLICY))
    keyring.create(domain=0, days=DAYS, hosts=())
    keyring.add('second', 'vehicle')
    shutil.rmtree(keyring.folder / 'vehicle')  # on a stick
    keyring.revoke('second')
    assert len(split_keys((keyring.folder / 'ground/stream.pub').read_bytes())) == 2
    keyring.renew()
    assert len(split_keys((keyring.folder / 'ground/stream.pub').read_bytes())) == 3
    assert (keyring.folder / 'vehicle/stream.key').is_file()


def test_a_renewal_that_fails_leaves_no_key_that_nobody_can_revoke(tmp_path):
    policy = read_policy(POLICY)
    folder = tmp_path / 'keys'
    Keyring(folder, policy).create(domain=0, days=DAYS, hosts=())
    last = {name: rights for name, rights in policy.items() if not name.endswith('/logger')}
    with pytest.raises(ConfigError, match='no enclave /plc_inspect/logger'):
        Keyring(folder, last).renew()
    register = Keyring(folder, policy).load()
    for name, member in register.members.items():
        certificate = x509.load_pem_x509_certificate((folder / name / 'member.crt').read_bytes())
        assert certificate.serial_number in (member.serial, *member.older)


@pytest.mark.parametrize(('arguments', 'message'), [
    (['create', '{keys}'], 'is not empty'),
    (['create', '{new}', '--days', '0'], '1 to 3650 days, not 0'),
    (['create', '{new}', '--domain', '233'], 'not 233'),
    (['add', '{keys}', 'ground', '--role', 'ground'], 'there already'),
    (['add', '{keys}', '../x', '--role', 'ground'], 'is not a name'),
    (['add', '{keys}', 'authority', '--role', 'ground'], 'is not a name'),
    (['add', '{keys}', 'x', '--role', 'admin'], 'is not a role'),
    (['revoke', '{keys}', 'nobody'], 'not a member with keys'),
    (['revoke', '{keys}', 'logger'], 'not a member with keys'),
    (['list', '{new}'], 'holds no keys'),
    (['profile', '{new}', '--connect', '17411'], 'is not a folder'),
    (['profile', '{keys}', '--connect', '80'], 'is not a port'),
    (['profile', '{keys}'], 'say where to listen'),
    (['tunnel', '{keys}/ground', '--port', '17411'], 'either listens or connects'),
    (['tunnel', '{keys}/ground', '--connect', '0.0.0.0:1', '--port', '17411'],
     'is not an ADDRESS:PORT'),
    (['tunnel', '{keys}', '--connect', '10.0.0.1:7411', '--port', '17411'], 'cannot be read'),
])
def test_what_is_wrong_is_said_in_one_line(keys, tmp_path, capsys, arguments, message):
    given = [item.format(keys=keys, new=tmp_path / 'new') for item in arguments]
    assert main(given) == 2
    error = capsys.readouterr().err
    assert error.startswith('plc_keys: ')
    assert message in error
    assert error.count('\n') == 1


def test_profiles_open_nothing_but_loopback():
    node = ElementTree.fromstring(make_profile(listen=17411, aboard=17412))
    kinds = [item.text for item in node.iter(f'{NAMESPACE}type')]
    assert kinds == ['SHM', 'UDPv4', 'TCPv4']
    ground = ElementTree.fromstring(make_profile(connect=17411))
    assert [item.text for item in ground.iter(f'{NAMESPACE}type')] == ['TCPv4']
    assert not list(ground.iter(f'{NAMESPACE}listening_ports'))
    driver = ElementTree.fromstring(make_profile(aboard=17412))
    for profile in (node, ground, driver):
        assert [item.text for item in profile.iter(f'{NAMESPACE}useBuiltinTransports')] == [
            'false'
        ]
        assert {item.text for item in profile.iter(f'{NAMESPACE}address')} == {'127.0.0.1'}
        sockets = [
            item for item in profile.iter(f'{NAMESPACE}transport_descriptor')
            if item.findtext(f'{NAMESPACE}type') != 'SHM'
        ]
        assert all(item.find(f'{NAMESPACE}interfaceWhiteList') is not None for item in sockets)
    with pytest.raises(ConfigError, match='either listens or connects'):
        make_profile(listen=17411, connect=17411)
    assert read_place('10.0.0.1:7411') == Place('10.0.0.1', 7411)
    for text in ('10.0.0.1', '10.0.0.1:80', 'host:7411', '0.0.0.0:7411', '::1:7411'):
        with pytest.raises(ConfigError):
            read_place(text)
    with pytest.raises(ConfigError):
        read_port('\u0663\u0663\u0663\u0663')


@pytest.mark.parametrize('change', [
    ('publish="ALLOW"', 'publish="DENY"'), ('<topic>odometry</topic>', '<topic>*</topic>'),
    ('<topic>odometry</topic>', '<topic></topic>'), ('reply=', 'offer='),
    ('version="0.2.0"', 'version="0.3.0"'), ('<policy', '<!DOCTYPE x []><policy'),
])
def test_a_policy_that_is_not_understood_is_refused(tmp_path, change):
    text = POLICY.read_text(encoding='utf-8')
    assert change[0] in text
    path = tmp_path / 'policy.xml'
    path.write_text(text.replace(*change), encoding='utf-8')
    with pytest.raises(ConfigError):
        read_policy(path)
