# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Messages of common_interfaces without ROS, for recordings."""

from typing import Any

import numpy as np
from numpy.typing import NDArray
from rosbags.typesys import get_typestore, Stores

from plc_inspect.messages.items import ORIGIN, Place
from plc_inspect.messages.markers import Mark, MarkKind
from plc_inspect.messages.rows import list_fields

DELETE_ALL = 3


class MessageMaker:
    """Makes and serialises messages of ROS 2 Jazzy."""

    def __init__(self) -> None:
        self.store = get_typestore(Stores.ROS2_JAZZY)

    def make(self, kind: str, **values: Any) -> Any:
        """Make a message."""
        return self.store.types[kind](**values)

    def serialize(self, message: Any, kind: str) -> bytes:
        """Return a message as CDR."""
        return bytes(self.store.serialize_cdr(message, kind))

    def define(self, kind: str) -> str:
        """Return the definition of a type, with the types it uses."""
        text, _ = self.store.generate_msgdef(kind, ros_version=2)
        return text

    def header(self, stamp_ns: int, frame_id: str) -> Any:
        """Make a header."""
        seconds, nanoseconds = divmod(max(stamp_ns, 0), 1_000_000_000)
        stamp = self.make('builtin_interfaces/msg/Time', sec=seconds, nanosec=nanoseconds)
        return self.make('std_msgs/msg/Header', stamp=stamp, frame_id=frame_id)

    def vector(self, kind: str, values: Place) -> Any:
        """Make a Point or a Vector3."""
        x, y, z = (float(value) for value in values)
        return self.make(f'geometry_msgs/msg/{kind}', x=x, y=y, z=z)

    def pose(self, place: Place) -> Any:
        """Make a pose that is not turned."""
        turn = self.make('geometry_msgs/msg/Quaternion', x=0.0, y=0.0, z=0.0, w=1.0)
        return self.make(
            'geometry_msgs/msg/Pose', position=self.vector('Point', place), orientation=turn
        )

    def bytes_array(self, data: bytes) -> Any:
        """Make a UInt8MultiArray."""
        layout = self.make('std_msgs/msg/MultiArrayLayout', dim=[], data_offset=0)
        return self.make(
            'std_msgs/msg/UInt8MultiArray', layout=layout,
            data=np.frombuffer(data, dtype=np.uint8),
        )

    def cloud(self, header: Any, rows: NDArray[Any], *, is_dense: bool = True) -> Any:
        """Make a PointCloud2 of (N,) rows, or an organised one of (H, W)."""
        height, width = rows.shape if rows.ndim == 2 else (1, len(rows))
        fields = [
            self.make('sensor_msgs/msg/PointField', name=name, count=1, offset=offset,
                      datatype=datatype)
            for name, offset, datatype in list_fields(rows.dtype)
        ]
        return self.make(
            'sensor_msgs/msg/PointCloud2', header=header, height=height, width=width,
            fields=fields, is_bigendian=False, point_step=rows.dtype.itemsize,
            row_step=rows.dtype.itemsize * width,
            data=np.frombuffer(rows.tobytes(), dtype=np.uint8), is_dense=is_dense,
        )

    def marker(self, header: Any, mark: Mark, action: int = 0) -> Any:
        """Make a marker."""
        empty = np.zeros(0, dtype=np.uint8)
        still = self.make('builtin_interfaces/msg/Time', sec=0, nanosec=0)
        red, green, blue, alpha = mark.rgba
        return self.make(
            'visualization_msgs/msg/Marker', header=header, ns=mark.namespace, id=mark.number,
            type=int(mark.kind), action=action, pose=self.pose(mark.position),
            scale=self.vector('Vector3', mark.scale),
            color=self.make('std_msgs/msg/ColorRGBA', r=red, g=green, b=blue, a=alpha),
            lifetime=self.make('builtin_interfaces/msg/Duration', sec=0, nanosec=0),
            frame_locked=False, points=[self.vector('Point', point) for point in mark.points],
            colors=[], texture_resource='',
            texture=self.make(
                'sensor_msgs/msg/CompressedImage', format='', data=empty,
                header=self.make('std_msgs/msg/Header', stamp=still, frame_id=''),
            ),
            uv_coordinates=[], text=mark.text, mesh_resource='',
            mesh_file=self.make('visualization_msgs/msg/MeshFile', filename='', data=empty),
            mesh_use_embedded_materials=False,
        )

    def deletion(self, header: Any) -> Any:
        """Make the marker that deletes all that were there before."""
        nothing = Mark(
            namespace='', number=0, kind=MarkKind.SPHERE, position=ORIGIN, scale=ORIGIN,
            color='#000000',
        )
        return self.marker(header, nothing, action=DELETE_ALL)
