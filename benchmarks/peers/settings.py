"""The sasktran2 settings that are compared: about a gigabyte, and the one that four gigabytes allow."""

from __future__ import annotations

from peers.sasktran2_sky import Setting

SETTINGS: dict[str, Setting] = {
    "coarse": Setting(zenith_step_deg=1.0, incoming=110, source_levels=(1.0, 0.3)),
    "middle": Setting(zenith_step_deg=0.5, incoming=302, source_levels=(1.0, 0.3)),
}
