# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Folders and files are there whole or not at all."""

import os
from pathlib import Path

import pytest

from plc_inspect.errors import DataError
from plc_inspect.whole_files import (
    check_file,
    check_folder,
    replace_file,
    replace_folder,
    sweep_partial,
)

REPLACE = {'folder': replace_folder, 'file': replace_file}


def put(place, text):
    """Write something into the folder, or the file."""
    (place / 'inside' if place.is_dir() else place).write_text(text, encoding='utf-8')


def get(place):
    """Return what was written."""
    return (place / 'inside' if place.is_dir() else place).read_text(encoding='utf-8')


def fail_half_way(kind, place, error):
    """Raise an error after something was written."""
    with REPLACE[kind](place) as aside:
        put(aside, 'half')
        raise error


def names(folder):
    """List what is in a folder, hidden files too."""
    return sorted(item.name for item in folder.iterdir())


@pytest.mark.parametrize('kind', REPLACE)
def test_it_takes_the_place_at_the_end_only(tmp_path, monkeypatch, kind):
    monkeypatch.chdir(tmp_path)
    place = Path('it.laz')
    for text in ('first', 'second'):
        with REPLACE[kind](place) as aside:
            put(aside, text)
            assert not place.exists() if text == 'first' else get(place) == 'first'
            assert aside.name == 'it.laz' or kind == 'folder'
        assert get(place) == text
        assert names(tmp_path) == ['it.laz']


@pytest.mark.parametrize('kind', REPLACE)
@pytest.mark.parametrize('error', [RuntimeError('bug'), KeyboardInterrupt(), SystemExit(143)])
@pytest.mark.parametrize('is_there', [False, True])
def test_failure_leaves_what_was_there(tmp_path, kind, error, is_there):
    if is_there:
        with REPLACE[kind](tmp_path / 'it') as aside:
            put(aside, 'old')
    with pytest.raises(type(error)):
        fail_half_way(kind, tmp_path / 'it', error)
    assert names(tmp_path) == (['it'] if is_there else [])
    assert not is_there or get(tmp_path / 'it') == 'old'


@pytest.mark.parametrize('kind', REPLACE)
def test_errors_of_the_system_name_the_place(tmp_path, kind):
    place = tmp_path / 'it'
    with pytest.raises(DataError, match='it cannot be written: full'), REPLACE[kind](place):
        raise OSError(28, 'full')
    with pytest.raises(DataError, match='it cannot be written: TimeoutError'), \
            REPLACE[kind](place):
        raise TimeoutError
    (tmp_path / 'file').write_text('', encoding='utf-8')
    with pytest.raises(DataError, match='deeper cannot be written: '), \
            REPLACE[kind](tmp_path / 'file' / 'deeper'):
        pass
    assert names(tmp_path) == ['file']


def test_an_old_folder_comes_back_where_the_new_one_cannot_be_put(tmp_path, monkeypatch):
    place, rename = tmp_path / 'it', Path.rename
    with replace_folder(place) as aside:
        put(aside, 'old')

    def fail(path, target):
        if path.name == 'new':
            raise PermissionError(13, 'Permission denied')
        return rename(path, target)

    monkeypatch.setattr(Path, 'rename', fail)
    with pytest.raises(DataError, match='Permission denied'), replace_folder(place) as aside:
        put(aside, 'new')
    assert get(place) == 'old'
    assert names(tmp_path) == ['it']


@pytest.mark.parametrize('kind', REPLACE)
def test_what_came_meanwhile_stays(tmp_path, kind):
    place = tmp_path / 'it'
    check = {'folder': check_folder, 'file': check_file}[kind]

    def put_meanwhile(aside):
        put(aside, 'new')
        with REPLACE[kind](place) as other:
            put(other, 'of another')

    with pytest.raises(DataError, match='--force replaces it'), \
            REPLACE[kind](place, lambda: check(place, False)) as aside:
        put_meanwhile(aside)
    assert get(place) == 'of another'
    assert names(tmp_path) == ['it']


@pytest.mark.parametrize('kind', REPLACE)
def test_who_may_read_it_is_for_the_user_to_say(tmp_path, kind):
    before = os.umask(0o027)
    try:
        with REPLACE[kind](tmp_path / 'it') as aside:
            put(aside, 'mine')
    finally:
        os.umask(before)
    assert (tmp_path / 'it').stat().st_mode & 0o777 == (0o750 if kind == 'folder' else 0o640)


def test_parents_are_made_for_folders_only(tmp_path):
    with replace_folder(tmp_path / 'a' / 'b') as aside:
        put(aside, 'deep')
    assert get(tmp_path / 'a' / 'b') == 'deep'
    with pytest.raises(DataError, match='No such file'), replace_file(tmp_path / 'c' / 'd'):
        pass


def test_what_is_there_needs_force(tmp_path):
    folder, file = tmp_path / 'folder', tmp_path / 'file'
    check_folder(folder, force=False)
    check_file(file, force=False)
    folder.mkdir()
    file.write_text('', encoding='utf-8')
    for check, place in ((check_folder, folder), (check_file, file)):
        with pytest.raises(DataError, match='exists; --force replaces it'):
            check(place, force=False)
        check(place, force=True)
    with pytest.raises(DataError, match='exists and is not a folder'):
        check_folder(file, force=True)
    (tmp_path / 'link').symlink_to(folder)
    with pytest.raises(DataError, match='exists and is not a folder'):
        check_folder(tmp_path / 'link', force=True)
    with pytest.raises(DataError, match='is a folder'):
        check_file(folder, force=True)
    with pytest.raises(DataError, match='nowhere is not a writable folder'):
        check_file(tmp_path / 'nowhere' / 'file', force=True)


def test_what_killed_runs_left_is_swept_and_what_is_held_stays(tmp_path):
    for name in ('.it.abc.partial', '.other.abc.partial'):
        (tmp_path / name / 'new').mkdir(parents=True)
    with replace_folder(tmp_path / 'it') as aside:
        put(aside, 'new')
        assert sweep_partial(tmp_path, 'it') == [tmp_path / '.it.abc.partial']
    assert get(tmp_path / 'it') == 'new'
    assert names(tmp_path) == ['.other.abc.partial', 'it']
    assert sweep_partial(tmp_path) == [tmp_path / '.other.abc.partial']
    assert sweep_partial(tmp_path / 'missing') == []


def test_results_that_were_moved_away_are_put_back(tmp_path):
    room = tmp_path / '.it.abc.partial'
    (room / 'old').mkdir(parents=True)
    put(room / 'old', 'good')
    assert sweep_partial(tmp_path) == [room]
    assert get(tmp_path / 'it') == 'good'
