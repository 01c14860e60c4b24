// The command that renders the same sky into files.
function clockText(hours) {
  const seconds = Math.round(hours * 3600) % 86400, two = (n) => String(n).padStart(2, "0");
  return [seconds / 3600, seconds / 60 % 60, seconds % 60].map((n) => two(Math.floor(n))).join(":");
}

function offsetText(zone) {
  const minutes = Math.round(Math.abs(zone) * 60), two = (n) => String(n).padStart(2, "0");
  return `${zone < 0 ? "-" : "+"}${two(Math.floor(minutes / 60))}:${two(minutes % 60)}`;
}

function renderCommand() {
  const scene = HEAD.scenes[HEAD.fields.length > 1 && state.split < 0.5 ? 1 : 0];
  const words = ["twilight render", /^[\w.\/+-]+$/.test(scene) ? scene : `'${scene.replaceAll("'", "'\\''")}'`];
  if (state.mode === "clock") {
    words.push(`--at ${state.date}T${clockText(state.hours)}${offsetText(state.zone)}`);
    words.push(`--latitude ${state.latitude} --longitude ${state.longitude}`);
  } else words.push(`--sun-elevation ${+theSun().elevation.toFixed(3)}`);
  if (HEAD.highest_km > HEAD.altitude_km[0] || state.altitude !== 0) words.push(`--altitude-km ${+state.altitude.toFixed(3)}`);
  if (state.night) words.push("--set night.airglow=1");
  if (lastExposed) words.push(`--exposure ${Math.log2(GREY / GREY_LUMINANCE / lastExposed).toFixed(2)}`);
  return words.join(" ");
}
