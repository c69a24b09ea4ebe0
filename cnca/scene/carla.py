"""Camera poses and pictures from CARLA, in the vehicle's own frame.

CARLA (and the Unreal Engine below it) is left-handed: x forward, y right, z up, angles in degrees;
positive yaw turns right, positive pitch looks up, positive roll leans to the right.  Ours is
right-handed with y to the left, so y changes its sign.
"""

from __future__ import annotations

import math
import os
import zipfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float

from cnca.core.errors import SceneError
from cnca.core.images import SrgbArray
from cnca.scene.cameras import View

MOST_BYTES = 2**28
"""Most bytes of an array: a picture of 8192 × 8192 pixels has three quarters of it."""

Pose = Float[np.ndarray, "2 3"]
"""Location in metres (x, y, z), then pitch, yaw, roll in degrees; left-handed."""


@dataclass(frozen=True)
class CarlaFrame:
    """One stored frame."""

    image: SrgbArray
    vehicle: Pose
    """The vehicle in the world."""
    camera: Pose
    """The camera in axes parallel to the world's, with its origin at the vehicle's location."""


def read_carla_frame(path: str | Path) -> CarlaFrame:
    """Read an ``.npz`` with ``img`` (uint8, blue-green-red), ``veh_trans`` and ``cam_trans``.

    Raises SceneError if the file is missing, unreadable, or an array is absent or malformed.
    """
    path = Path(path)
    if not os.path.isfile(path):  # also of names that no system takes
        raise SceneError(f"{path}: no such CARLA frame; paths start at the scene file's folder")
    try:
        with zipfile.ZipFile(path) as archive:
            arrays = {key: _array(archive, key) for key in ("img", "veh_trans", "cam_trans")}
    except KeyError as error:
        raise SceneError(
            f"{path}: {error.args[0]}; a frame has img, veh_trans, cam_trans"
        ) from None
    except Exception as error:  # zipfile, zlib and NumPy share no base of what they raise
        reason = " ".join(str(error).split())
        raise SceneError(f"{path}: cannot be read as .npz ({reason})") from None
    image = arrays["img"]
    if image.dtype != np.uint8 or image.ndim != 3 or image.shape[2] != 3:
        raise SceneError(f"{path}: img: expected uint8 (height, width, 3), got {image.shape}")
    for key in ("veh_trans", "cam_trans"):
        numbers = arrays[key].dtype.kind in "fiu"
        if not numbers or arrays[key].shape != (2, 3) or not np.isfinite(arrays[key]).all():
            raise SceneError(f"{path}: {key}: expected 2 × 3 finite numbers")
    red_green_blue = image[..., ::-1].astype(np.float32) / 255
    return CarlaFrame(red_green_blue, arrays["veh_trans"], arrays["cam_trans"])


def _array(archive: zipfile.ZipFile, key: str) -> np.ndarray:
    """An array of an ``.npz``, unless its header or its packing would fill the memory."""
    name = f"{key}.npy"
    size = archive.getinfo(name).file_size
    with archive.open(name) as member:
        version = np.lib.format.read_magic(member)
        read_header = {
            (1, 0): np.lib.format.read_array_header_1_0,
            (2, 0): np.lib.format.read_array_header_2_0,
        }[version]
        shape, _, dtype = read_header(member)
    if max(size, math.prod(shape) * dtype.itemsize) > MOST_BYTES:
        raise ValueError(f"{key} of shape {shape} is larger than any picture")
    with archive.open(name) as member:
        return np.asarray(np.lib.format.read_array(member, allow_pickle=False))


def carla_view(
    vehicle: Pose,
    camera: Pose,
    *,
    lift: float,
    width: int,
    height: int,
    fov: float = 90.0,
    name: str = "carla",
) -> View:
    """Return CARLA's camera as a view of the vehicle that stands at our origin and faces +x.

    Args:
        vehicle: the vehicle in the world (only its rotation matters).
        camera: the camera in world-parallel axes, relative to the vehicle's location.
        lift: metres by which our z = 0 (the lowest point of the vehicle) lies above the vehicle's
            location along its own up axis; negative where CARLA's location is above the ground.
            It differs between frames where the stored location is the one that the vehicle was
            dropped from onto its springs; :func:`cnca.vehicle.outline.fit_lift` measures it.
        width: pixels per row.
        height: rows.
        fov: horizontal field of view in degrees.
        name: of the view.
    """
    to_vehicle = rotation(*vehicle[1]).T
    origin = _right_handed(to_vehicle @ camera[0]) - (0.0, 0.0, lift)
    axes = to_vehicle @ rotation(*camera[1])
    forward, up = _right_handed(axes[:, 0]), _right_handed(axes[:, 2])
    return View(
        name=name,
        origin=_vector(origin),
        target=_vector(origin + forward),
        up=_vector(up),
        fov=fov,
        width=width,
        height=height,
    )


def rotation(pitch: float, yaw: float, roll: float) -> Float[np.ndarray, "3 3"]:
    """The columns are the forward, right and up axes of a left-handed CARLA pose (degrees).

    Roll about x comes first, then pitch, then yaw, as in the Unreal Engine's FRotationMatrix.
    """
    p, y, r = (math.radians(angle) for angle in (pitch, yaw, roll))
    cp, sp, cy, sy, cr, sr = (f(a) for a in (p, y, r) for f in (math.cos, math.sin))
    return np.array(
        [
            [cp * cy, sr * sp * cy - cr * sy, -cr * sp * cy - sr * sy],
            [cp * sy, sr * sp * sy + cr * cy, -cr * sp * sy + sr * cy],
            [sp, -sr * cp, cr * cp],
        ]
    )


def _right_handed(vector: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3"]:
    return vector * (1.0, -1.0, 1.0)


def _vector(values: Float[np.ndarray, "3"]) -> tuple[float, float, float]:
    x, y, z = (float(value) for value in values)
    return x, y, z
