"""The sasktran2 settings that are compared, from its defaults to the most exact that is affordable."""

from __future__ import annotations

from peers.sasktran2_sky import Setting

SETTINGS: dict[str, Setting] = {
    "defaults": Setting(
        zenith_step_deg=None, single_levels=(1.0, 0.0), source_levels=None, outgoing=110, tolerance=1e-6
    ),
    "coarse": Setting(zenith_step_deg=1.0, incoming=110, source_levels=(1.0, 0.3)),
    "middle": Setting(zenith_step_deg=0.5, incoming=302, source_levels=(1.0, 0.3)),
    "fine": Setting(zenith_step_deg=0.5, incoming=770, outgoing=302, streams=24),
}
