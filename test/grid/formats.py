# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Writes clouds in formats that are read, and none of the package writes."""

import struct
from unittest.mock import patch

import laspy
import lazrs
import numpy as np

CAPACITY = 300
"""Points of a node of a COPC file."""


def write_copc(path, points, capacity=CAPACITY):
    """Write points as COPC 1.0: LAZ with an octree of nodes, its index in an extended record."""
    header = laspy.LasHeader(version='1.4', point_format=7)
    header.scales, header.offsets = np.full(3, 0.001), np.floor(points.min(axis=0))
    record = laspy.ScaleAwarePointRecord.zeros(len(points), header=header)
    record.x, record.y, record.z = points.T
    record['classification'] = np.arange(len(points)) % 7
    center = (points.min(axis=0) + points.max(axis=0)) / 2
    half = float(np.ptp(points, axis=0).max()) / 2 + 0.01
    nodes = []

    def divide(key, rows):
        """Keep some points in a node, and give the others to its children."""
        nodes.append((key, np.sort(rows[:capacity])))
        rest = rows[capacity:]
        level = key[0]
        size = 2 * half / 2 ** (level + 1)
        child = np.floor((points[rest] - (center - half)) / size).astype(int)
        for own in np.unique(child, axis=0):
            divide((level + 1, *own.tolist()), rest[(child == own).all(axis=1)])

    divide((0, 0, 0, 0), np.random.default_rng(0).permutation(len(points)))
    laz = lazrs.LazVlr.new_for_compression(7, 0, True)
    options = bytes(laz.record_data())
    before = 375 + 54 + 160 + 54 + len(options)
    with path.open('wb') as file:
        file.write(b'\0' * before)
        packer, ends = lazrs.LasZipCompressor(file, laz), []
        for _, rows in nodes:
            packer.compress_many(np.frombuffer(record.array[rows].tobytes(), np.uint8))
            packer.finish_current_chunk()
            ends.append(file.tell())
        packer.done()
        first_record = file.tell()
        begins = [before + 8, *ends[:-1]]
        index = b''.join(
            struct.pack('<4i', *key) + struct.pack('<Qii', begin, end - begin, len(rows))
            for (key, rows), begin, end in zip(nodes, begins, ends, strict=True)
        )
        file.write(struct.pack('<H16sHQ32s', 0, b'copc', 1000, len(index), b''))
        at_index = file.tell()
        file.write(index)
        file.seek(0)
        header.point_count = len(points)
        header.mins, header.maxs = points.min(axis=0), points.max(axis=0)
        header.number_of_points_by_return[0] = len(points)
        file.write(_render_head(header, before, first_record))
        file.write(struct.pack('<H16sHH32s', 0, b'copc', 1, 160, b''))
        file.write(struct.pack('<5d2Q2d11Q', *center, half, 1.0, at_index, len(index), 0.0, 0.0,
                               *[0] * 11))
        file.write(struct.pack('<H16sHH32s', 0, b'laszip encoded', 22204, len(options), b''))
        file.write(options)
    return path


def _render_head(header, first_point, first_record):
    """Return the 375 bytes of the head of LAS 1.4, point format 7, compressed."""
    high_low = [value for pair in zip(header.maxs, header.mins, strict=True) for value in pair]
    return b''.join([
        b'LASF', struct.pack('<HH16sBB', 0, 16, b'', 1, 4), b'\0' * 64,
        struct.pack('<HHHIIBH', 1, 2026, 375, first_point, 2, 7 | 128, header.point_format.size),
        struct.pack('<I5I', 0, *[0] * 5), struct.pack('<6d', *header.scales, *header.offsets),
        struct.pack('<6d', *high_low), struct.pack('<Q', 0), struct.pack('<QI', first_record, 1),
        struct.pack('<Q15Q', header.point_count, header.point_count, *[0] * 14),
    ])


def write_e57(path, points, *, rotation=None, translation=None, crs='', **more):
    """Write points as one scan of an E57 file, with a reference system where one is given."""
    import pye57

    class Nodes:
        """What pye57 writes with, but for the one empty text: that of the reference system."""

        def __getattr__(self, name):
            return getattr(pye57.libe57, name)

        def StringNode(self, file, text):
            return pye57.libe57.StringNode(file, text or crs)

    with patch.object(pye57.e57, 'libe57', Nodes()):
        return _write_e57(path, points, rotation, translation, more)


def _write_e57(path, points, rotation, translation, more):
    import pye57

    columns = dict(zip(('cartesianX', 'cartesianY', 'cartesianZ'), points.T.copy(), strict=True))
    with pye57.E57(str(path), mode='w') as file:
        file.write_scan_raw(columns | more, rotation=rotation, translation=translation)
    return path


def write_ply(path, points, *, text=False, names='xyz', kind='f8'):
    """Write points as PLY."""
    import plyfile

    table = np.array(list(map(tuple, points.tolist())), dtype=[(name, kind) for name in names])
    plyfile.PlyData(
        [plyfile.PlyElement.describe(table, 'vertex')], text=text,
        byte_order='>' if kind.startswith('>') else '<',
    ).write(str(path))
    return path


def write_xyz(path, points, *, mark=' ', head=''):
    """Write points as text."""
    np.savetxt(path, points, fmt='%.3f', delimiter=mark, header=head, comments='')
    return path


def write_pcd(path, points):
    """Write points as PCD, binary, in double precision."""
    head = (
        f'VERSION 0.7\nFIELDS x y z\nSIZE 8 8 8\nTYPE F F F\nCOUNT 1 1 1\nWIDTH {len(points)}\n'
        f'HEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {len(points)}\nDATA binary\n'
    )
    path.write_bytes(head.encode() + points.astype('<f8').tobytes())
    return path
