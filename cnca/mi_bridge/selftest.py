"""A tiny render that shows whether the renderer works on this machine.

``python -m cnca.mi_bridge.selftest`` prints the outcome as JSON; the doctor runs it in a process of
its own, because an unusable LLVM aborts the process instead of raising.
"""

from __future__ import annotations

import json

import numpy as np
from jaxtyping import Float

from cnca.mi_bridge.variant import mi

_SIZE = 32


def render_sphere() -> Float[np.ndarray, "32 32 3"]:
    """Return linear radiance of a textured ball under a constant sky of radiance 1.

    The ball has a principled BSDF and a texture, since it is these that old LLVMs cannot compile.
    """
    checker = {"type": "checkerboard", "color0": 0.2, "color1": 0.8}
    scene = mi.load_dict(
        {
            "type": "scene",
            "integrator": {"type": "path", "max_depth": 3, "hide_emitters": True},
            "sensor": {
                "type": "perspective",
                "fov": 40,
                "to_world": mi.ScalarTransform4f().look_at([0, -4, 0], [0, 0, 0], [0, 0, 1]),
                "film": {"type": "hdrfilm", "width": _SIZE, "height": _SIZE},
            },
            "sky": {"type": "constant"},
            "ball": {"type": "sphere", "bsdf": {"type": "principled", "base_color": checker}},
        }
    )
    return np.array(mi.render(scene, spp=16, seed=0))[..., :3]


def main() -> None:
    """Print variant, mean radiance and whether every pixel is finite as one JSON object."""
    image = render_sphere()
    outcome = {
        "variant": mi.variant(),
        "mean": float(np.nan_to_num(image).mean()),
        "finite": bool(np.isfinite(image).all()),
    }
    print(json.dumps(outcome))


if __name__ == "__main__":
    main()
