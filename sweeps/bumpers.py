"""Rubber bumpers between floors: contact laws that `bumpers.toml` names."""

from pounding_sweep import rubber_bumper

# 400 kN squeeze the thin one to half its thickness (m), 400 kN the thick one too
thin = rubber_bumper(0.03, stiffness=400 / 0.015**2.65, key="bumper_30_mm")
thick = rubber_bumper(0.06, stiffness=400 / 0.030**2.65, key="bumper_60_mm")
