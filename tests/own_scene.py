"""What a newcomer would write into a scene: an effect, a sky and a world of one's own."""

from dataclasses import replace

import numpy as np

from cnca.effects.effect import Effect
from cnca.scene.environment import sky_directions
from cnca.world.builtin.meshes import box, rectangle
from cnca.world.builtin.site import Pose, Site
from cnca.world.model import Place


class AerosolEffect(Effect):
    """Dust in the air, which makes the sky whiter; left out, the air is as clean as can be.

    Its Mitsuba side is there already: the sky is baked from the weather that a plan leaves over.
    """

    name = "aerosol"
    models = ("off", "sky")
    usual = "sky"

    def present(self, subject):
        """Clean air has none, and a measured sky holds its own."""
        dusty = subject.weather.turbidity > 1 and subject.weather.sky_map is None
        return self.models if dusty else self.models[:1]

    def within(self, model, weather):
        return replace(weather, turbidity=1.0) if model == "off" else weather

    def why(self, model, subject, error):
        return f"turbidity {subject.weather.turbidity:g}" if model == "sky" else "clean air"


def overcast(rows: int) -> np.ndarray:
    """The overcast sky of the CIE over black ground, as a picture for ``sky.map``.

    Its radiance is (1 + 2 sin θ) / 3 at the altitude θ, 1 in the zenith.
    """
    sine = sky_directions(rows, 2 * rows)[..., 2:]
    return np.where(sine > 0, (1 + 2 * sine) / 3, 0.0).repeat(3, axis=2).astype(np.float32)


def plaza(rng: np.random.Generator):
    """A paved square with a house beside it, whose height is drawn."""
    site, height = Site(), rng.uniform(6.0, 12.0)
    site.add("asphalt", rectangle((-30.0, 30.0), (-30.0, 30.0), 0.0), Pose())
    site.add("concrete", box((-8.0, 10.0, 0.0), (8.0, 20.0, height)), Pose())
    return site.world("builtin:plaza", [Place(0.0, 0.0), Place(-15.0, 0.0, 0.0, 90.0)])
