"""A look at the car on its track, drawn by the engine without a display.

It is drawn in a process of its own, since a missing graphics driver may end one:
`python -m vdmsi_jax.testbed.picture` takes a scene as JSON on its standard input.
"""

import json
import os
import struct
import subprocess
import sys
import zlib
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, UInt8

from .car import Car
from .engine import load_mujoco
from .mjcf import mjcf

BACKENDS = ("egl", "osmesa")
"""Ways of MuJoCo to draw without a display, in the order in which they are tried."""

_SIZE = (300, 440)  # rows and columns of one view
_DASH = 1.0  # m, of the white line
_TIMEOUT = 120.0  # s


def look(
    path: Path, track: Float[np.ndarray, "M 2"], moments: Float[np.ndarray, "K 4"]
) -> str | None:
    """Draw the car at several moments side by side into a PNG file.

    Args:
        path: of the file.
        track: points along the designed path, m.
        moments: x, y (m), psi and road-wheel angle (rad) of each.

    Returns:
        None, or why there is no picture: nothing here fails.
    """
    scene = json.dumps({"path": str(path), "track": track.tolist(), "moments": moments.tolist()})
    said = ""
    for backend in BACKENDS:
        environment = {**os.environ, "MUJOCO_GL": backend}
        try:
            done = subprocess.run(
                [sys.executable, "-m", "vdmsi_jax.testbed.picture"],
                input=scene, env=environment, capture_output=True, text=True, timeout=_TIMEOUT,
            )  # fmt: skip
        except (OSError, subprocess.TimeoutExpired) as error:
            said = str(error)
            continue
        if done.returncode == 0:
            return None
        said = (done.stderr.strip().splitlines() or [f"it ended with {done.returncode}"])[-1]
    return f"MuJoCo could not draw without a display ({said})"


def draw(scene: dict[str, Any]) -> None:
    """Draw a scene as `look` describes it, and write the file."""
    mujoco = load_mujoco()
    world = mjcf(Car()).replace("</worldbody>", _line(np.array(scene["track"])) + "</worldbody>")
    model = mujoco.MjModel.from_xml_string(world)
    data, camera = mujoco.MjData(model), mujoco.MjvCamera()
    views = []
    with mujoco.Renderer(model, *_SIZE) as renderer:
        for x, y, psi, delta in scene["moments"]:
            data.qpos[:2] = x, y
            data.qpos[3:7] = np.cos(0.5 * psi), 0.0, 0.0, np.sin(0.5 * psi)
            for side in ("left", "right"):
                data.joint(f"kingpin_front_{side}").qpos[0] = delta
            mujoco.mj_forward(model, data)
            camera.lookat[:] = x + 1.5 * np.cos(psi), y + 1.5 * np.sin(psi), 0.3
            camera.distance, camera.elevation = 11.0, -24.0
            camera.azimuth = np.degrees(psi) + 28.0
            renderer.update_scene(data, camera)
            views.append(renderer.render().copy())
    gap = np.full((_SIZE[0], 8, 3), 255, np.uint8)
    strip = [part for view in views for part in (view, gap)][:-1]
    target = Path(scene["path"])
    unfinished = target.with_name(f".{target.name}.part")
    unfinished.write_bytes(png(np.concatenate(strip, axis=1)))
    unfinished.replace(target)


def png(pixels: UInt8[np.ndarray, "H W 3"]) -> bytes:
    """Pixels as a PNG file (RFC 2083: no filter, one compressed chunk)."""

    def chunk(kind: bytes, body: bytes) -> bytes:
        check = struct.pack(">I", zlib.crc32(kind + body))
        return struct.pack(">I", len(body)) + kind + body + check

    height, width, _ = pixels.shape
    head = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    # The filter "up" makes smooth pictures small; the first row has nothing above it.
    above = np.concatenate([np.zeros_like(pixels[:1]), pixels[:-1]])
    rows = (pixels - above).reshape(height, -1)
    lines = np.concatenate([np.full((height, 1), 2, np.uint8), rows], axis=1)
    body = chunk(b"IHDR", head) + chunk(b"IDAT", zlib.compress(lines.tobytes(), 9))
    return b"\x89PNG\r\n\x1a\n" + body + chunk(b"IEND", b"")


def _line(track: Float[np.ndarray, "M 2"]) -> str:
    """A dashed white line on the road."""
    steps = np.hypot(*np.diff(track, axis=0).T)
    gone = np.concatenate([[0.0], np.cumsum(steps)])
    at = np.arange(0.5 * _DASH, gone[-1], 2.0 * _DASH)
    x, y = (np.interp(at, gone, column) for column in track.T)
    courses = np.unwrap(np.arctan2(*np.diff(track, axis=0).T[::-1]))
    course = np.interp(at, 0.5 * (gone[1:] + gone[:-1]), courses)
    return "".join(
        f'<geom type="box" pos="{a:.4f} {b:.4f} 0.005" size="{0.5 * _DASH} 0.06 0.004" '
        f'euler="0 0 {c:.5f}" rgba="1 1 1 1" contype="0" conaffinity="0"/>'
        for a, b, c in zip(x, y, course, strict=True)
    )


if __name__ == "__main__":
    draw(json.load(sys.stdin))
