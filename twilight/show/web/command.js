// The commands that render the same picture into files: one for each sky of the page.
function clockText(hours) {
  const seconds = Math.round(hours * 3600) % 86400, two = (n) => String(n).padStart(2, "0");
  return [seconds / 3600, seconds / 60 % 60, seconds % 60].map((n) => two(Math.floor(n))).join(":");
}

function offsetText(zone) {
  const minutes = Math.round(Math.abs(zone) * 60), two = (n) => String(n).padStart(2, "0");
  return `${zone < 0 ? "-" : "+"}${two(Math.floor(minutes / 60))}:${two(minutes % 60)}`;
}

// HEAD.scenes: a configuration and its options as `twilight render` takes them, quoted for a shell.
const renderCommand = () => HEAD.scenes.map((scene) => ["twilight render", scene, ...sunOptions(), ...viewOptions(), ...pictureOptions()].join(" ")).join("\n");

function sunOptions() {
  const words = [];
  if (state.mode === "clock") {
    words.push(`--at ${state.date}T${clockText(state.hours)}${offsetText(state.zone)}`);
    words.push(`--latitude ${state.latitude} --longitude ${state.longitude}`);
  } else words.push(`--sun-elevation ${+theSun().elevation.toFixed(3)}`);
  if (HEAD.highest_km > HEAD.altitude_km[0] || state.altitude !== 0) words.push(`--altitude-km ${+state.altitude.toFixed(3)}`);
  if (state.night) words.push("--set night.airglow=1");
  const { moonElevation: e, moonAzimuth: a } = state;
  if (state.moon) words.push(state.mode === "clock" ? "--set moon={}" : `--set "moon={elevation_deg: ${+e.toFixed(3)}, azimuth_deg: ${+a.toFixed(3)}}"`);
  if (state.disc) words.push("--disc");
  return words;
}

// A fisheye of files is square and their latitude-longitude is the whole sphere, upright.
function viewOptions() {
  const { projection } = state, w = canvas.width, h = canvas.height, set = (key, value) => `--set observer.view.${key}=${+value.toFixed(3)}`;
  const size = { perspective: `${w}x${h}`, fisheye: Math.max(16, Math.min(w, h)), latlong: Math.max(16, 2 * Math.round(w / 2)) }[projection];
  const words = [`--projection ${projection} --size ${size}`, set("azimuth_deg", around(state.azimuth - theSun().azimuth + 180, 360) - 180)];
  if (projection !== "latlong") words.push(set("elevation_deg", state.elevation), set("field_of_view_deg", state.fov));
  return words;
}

const pictureOptions = () => [`--tone ${state.tone}`, ...(shot?.ev === undefined ? [] : [`--exposure ${shot.ev.toFixed(2)}`])];
