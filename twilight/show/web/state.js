// What is shown. Every control sets one of these; `twilight.set` does the same for scripts.
const HEAD = JSON.parse(document.getElementById("head").textContent);

const state = {
  mode: "elevation",     // elevation | clock
  sun: -4,               // true elevation of the sun, deg
  date: "2026-03-20", hours: 18.5, zone: 1, latitude: 48, longitude: 11,
  running: false, speed: 60, path: true,
  projection: "perspective", fov: 100, azimuth: 0, elevation: 16,
  altitude: HEAD.altitude_km[0], labels: true, split: HEAD.fields.length > 1 ? 0.5 : 1,
  tone: "photographic",  // photographic | eye
  exposure: "metered", ev: 8, bias: 0,   // metered | manual
  disc: true, night: true, stars: true, moon: false,
  aerosol: 0, stratosphere: 0, ozone: 0, albedo: 0,   // optical depths at 550 nm, DU, part of light
  moonElevation: 25, moonAzimuth: 120,   // true, and from the sun's azimuth, deg, where there is no clock
  ...HEAD.start,
};
if (HEAD.kind === "sky") Object.assign(state, { mode: "elevation", sun: HEAD.sun_deg[0], disc: false, night: false, stars: false, moon: false });

const UPRIGHT = { fov: 60, elevation: 22 };   // where the screen is higher than wide: the horizon stands above the sheet

const byId = (id) => document.getElementById(id);
let wanted = true;       // whether the picture must be drawn again
const redraw = () => { wanted = true; };
