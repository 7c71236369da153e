"""Lights of a scene in the browser, without shadows and reflections, which cost most without a GPU."""

import viser

__all__ = ["add_lights"]


def add_lights(scene: viser.SceneApi) -> None:
    """Add light from all sides, from the sky, and from two lamps; default lights are switched off."""
    scene.configure_default_lights(enabled=False, cast_shadow=False)
    scene.configure_environment_map(None)
    scene.add_light_ambient("/light/all", intensity=0.6)
    scene.add_light_hemisphere(
        "/light/sky", sky_color=(255, 255, 255), ground_color=(120, 120, 135), intensity=0.8
    )
    for name, position, intensity in (("key", (2.0, 1.5, 4.0), 1.1), ("fill", (-2.0, -3.0, 2.0), 0.35)):
        scene.add_light_directional(
            f"/light/{name}", intensity=intensity, cast_shadow=False, position=position
        )
