"""The sasktran2 settings that are compared, from its defaults to the most exact that is affordable."""

from __future__ import annotations

from peers.sasktran2_sky import Setting

SETTINGS: dict[str, Setting] = {
    "defaults": Setting(n_sza=1, incoming=110, outgoing=110, streams=16, single_levels=(1.0, 0.0), tolerance=1e-6),
    "coarse": Setting(n_sza=11, incoming=110, outgoing=110),
    "middle": Setting(n_sza=21, incoming=302, outgoing=110),
    "fine": Setting(n_sza=41, incoming=590, outgoing=302),
}
