"""A robot sized for a mouth, for whoever has a place and no robot yet."""

from __future__ import annotations

DIAMETER_FRACTION = 0.3
"""Of the mouth: diameter of the robot."""
_TEMPLATE_DIAMETER = 0.003


def sized_robot(mouth: float) -> str:
    """Returns the text of a robot file: a borescope of two segments in a sleeve, scaled to a mouth.

    Lengths scale with the mouth, tensions with its square and masses with its cube, so that the shape under full
    tension is the same at each size.

    Args:
        mouth: Diameter of the mouth, m.
    """
    scale = DIAMETER_FRACTION * mouth / _TEMPLATE_DIAMETER
    segment = f"""
[[segments]]
length_m = {0.05 * scale:.6g}
disks = 12
disk_radius_m = {0.0015 * scale:.6g}
disk_thickness_m = {0.001 * scale:.6g}
disk_mass_kg = {1e-5 * scale**3:.6g}
tendon_circle_radius_m = {0.0012 * scale:.6g}
tendon_angles_deg = %s
max_tension_n = {15.0 * scale**2:.6g}
"""
    return f"""# A borescope of two segments, sized for a mouth of {1e3 * mouth:.4g} mm.
format = "tdcr-robot/1"
name = "borescope for {1e3 * mouth:.4g} mm"

[backbone]
youngs_modulus_pa = 60e9
poisson_ratio = 0.3
radius_m = {0.00035 * scale:.6g}
density_kg_m3 = 6450.0
{segment % "[90.0, -30.0, 210.0]"}{segment % "[30.0, 150.0, 270.0]"}
[tip]
mass_kg = {0.0005 * scale**3:.6g}

[body]
between_disks = "sleeve"
tendon_radius_m = {0.00015 * scale:.6g}
"""
