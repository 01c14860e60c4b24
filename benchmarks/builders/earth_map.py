"""A coarse albedo map of the Earth, drawn by hand: sea, vegetation, desert and ice by wavelength.

    python benchmarks/builders/earth_map.py earth.nc
    twilight render earth-from-36000-km --set ground.albedo_map=earth.nc --at 2026-06-21T10:00Z --latitude 0 \
        --longitude 10 --set observer.view.azimuth_deg=-39

It shows what `ground.albedo_map` takes; real ones come with many data sets of land and sea.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))  # benchmarks, where results is
import results
import xarray
from matplotlib.path import Path

LAND = {  # (longitude, latitude) [deg]
    "Africa": [(-6, 36), (10, 37), (11, 33), (20, 31), (32, 31), (43, 12), (51, 12), (40, -4), (40, -15), (35, -24),
               (31, -30), (26, -34), (18, -34), (12, -17), (13, -6), (9, 4), (-8, 5), (-17, 15), (-13, 28)],
    "Eurasia": [(-9, 37), (-9, 43), (-1, 44), (-4, 48), (8, 54), (10, 58), (5, 60), (14, 68), (28, 71), (60, 69),
                (105, 77), (180, 69), (162, 60), (156, 51), (140, 54), (128, 42), (126, 35), (121, 40), (122, 30),
                (109, 20), (109, 11), (103, 2), (98, 9), (91, 22), (80, 15), (77, 8), (70, 22), (57, 26), (60, 22),
                (45, 13), (35, 28), (36, 36), (27, 37), (23, 37), (19, 42), (13, 45), (18, 40), (15, 38), (8, 44),
                (3, 42), (-2, 37)],
    "Britain": [(-5, 50), (1, 51), (-2, 56), (-3, 58), (-6, 57), (-3, 54)],
    "Madagascar": [(44, -25), (47, -25), (50, -15), (44, -17)],
    "Australia": [(114, -22), (115, -34), (131, -31), (140, -38), (150, -37), (153, -27), (142, -11), (136, -12),
                  (130, -13)],
    "North America": [(-166, 66), (-125, 70), (-82, 69), (-78, 62), (-65, 59), (-56, 52), (-70, 43), (-81, 31),
                      (-81, 25), (-84, 30), (-97, 27), (-96, 19), (-87, 21), (-83, 10), (-106, 23), (-124, 40),
                      (-130, 55), (-152, 60)],
    "South America": [(-77, 8), (-60, 9), (-50, 0), (-35, -6), (-39, -18), (-48, -27), (-58, -36), (-66, -45),
                      (-69, -54), (-75, -50), (-70, -18), (-81, -5)],
    "Greenland": [(-45, 60), (-22, 70), (-20, 81), (-60, 82), (-55, 68)],
}  # fmt: skip
WAVELENGTH_NM = np.array([400.0, 480.0, 550.0, 620.0, 680.0, 720.0])
ALBEDO = np.array([
    [0.06, 0.05, 0.03, 0.02, 0.02, 0.02],  # sea
    [0.03, 0.04, 0.09, 0.07, 0.06, 0.16],  # vegetation
    [0.12, 0.18, 0.28, 0.37, 0.41, 0.43],  # desert
    [0.80, 0.82, 0.82, 0.80, 0.78, 0.76],  # ice
])  # fmt: skip


def main() -> None:
    lat, lon = np.arange(-89.75, 90.0, 0.5), np.arange(-179.75, 180.0, 0.5)
    x, y = np.meshgrid(lon, lat)
    places = np.column_stack([x.ravel(), y.ravel()])
    kind = np.zeros(x.shape, int)
    for name, outline in LAND.items():
        kind[Path(outline).contains_points(places).reshape(x.shape)] = 3 if name == "Greenland" else 1
    dry = (np.abs(y - 22.0) < 8.0) & (x > -20.0) & (x < 60.0) | (np.abs(y + 25.0) < 6.0) & (x > 110.0)
    kind[(kind == 1) & dry] = 2
    kind[y < -70.0] = 3
    made = xarray.DataArray(
        ALBEDO[kind], {"lat": lat, "lon": lon, "wavelength": WAVELENGTH_NM}, ("lat", "lon", "wavelength")
    )
    made["wavelength"].attrs["units"] = "nm"
    made.to_dataset(name="albedo").to_netcdf(sys.argv[1], engine="h5netcdf")


if __name__ == "__main__":
    results.say_help(__doc__)
    main()
