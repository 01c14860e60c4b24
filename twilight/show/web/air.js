// The sky of sliders: workers compute its table anew whenever the air, the observer or the sun is another.
const AMOUNTS = ["aerosol", "stratosphere", "ozone", "albedo"];
const MOST_WORKERS = 4;
const sliders = { workers: [], asked: null, since: 0, answers: [], busy: false, error: 0, milliseconds: 0 };

// What workers are asked for: factors of the amounts that the page was made of.
function questionOf() {
  const { now } = HEAD.air, [aerosol, stratosphere, ozone] = AMOUNTS.map((name) => (now[name] > 0 ? state[name] / now[name] : 1));
  return { aerosol, stratosphere, ozone, albedo: state.albedo, observer: state.altitude - HEAD.altitude_km[0], sun: theSun().shown };
}

// The first sky; each worker has some of the wavelengths.
function startAir() {
  const { column, columns, now, screen } = HEAD.air, { log_spectrum: logSpectrum, colour, ozone, model, below, above } = tables;
  const program = URL.createObjectURL(new Blob([HEAD.worker], { type: "text/javascript" })), count = Math.min(navigator.hardwareConcurrency || 1, MOST_WORKERS, HEAD.fields[0].wavelength_nm.length);
  return new Promise((resolve, reject) => {
    for (let k = 0; k < count; k++) {
      const worker = new Worker(program);
      worker.postMessage({ model, below, above, ozone, colour, logSpectrum, column, columns, rows: HEAD.row_deg, albedo: now.albedo, screen, phaseCount: LINE / 4 });
      worker.onerror = (e) => reject(new Error(e.message));
      worker.onmessage = ({ data }) => { if (data.light) takeLight(data); else { takeSky(data); resolve(); } };
      sliders.workers.push(worker);
    }
    followSliders();
  });
}

// Asks for the sky of the sliders, if it is another one; returns whether it does.
function followSliders() {
  const question = questionOf();
  if (sliders.busy || JSON.stringify(question) === JSON.stringify(sliders.asked)) return false;
  Object.assign(sliders, { asked: question, since: performance.now(), answers: [], busy: true });
  sliders.workers.forEach((worker, part) => worker.postMessage({ ...question, part, parts: sliders.workers.length }));
  return true;
}

// When all workers have answered, the first one puts the table together.
function takeLight(answer) {
  const { answers, workers, asked } = sliders;
  answers[answer.part] = answer;
  if (workers.every((_, k) => answers[k])) workers[0].postMessage({ answers, sun: asked.sun });
}

function takeSky({ smooth, aureole, phase, spectrum, apparent, error }) {
  const rows = HEAD.row_deg.length, columns = HEAD.column_deg.length, shape = (n) => ({ shape: [n, 1, 1, rows, columns] });
  Object.assign(tables, { sky0: smooth, aureole0: aureole, phase0_0: phase, spectrum0: spectrum });
  Object.assign(HEAD.arrays, { sky0: shape(4), aureole0: shape(4), spectrum0: shape(HEAD.fields[0].wavelength_nm.length) });
  HEAD.fields[0].lift_deg = [[apparent - sliders.asked.sun]];
  Object.assign(sliders, { busy: false, error, milliseconds: performance.now() - sliders.since });
  sliced = "";
  redraw();
}

// Ranges of the sliders, and those that have nothing to change.
function startSliders() {
  if (HEAD.kind !== "air") return;
  for (const name of AMOUNTS) {
    byId(name).min = 0;
    byId(name).max = positionOf(name, HEAD.air.most[name]);
    byId(name).parentElement.hidden = !(HEAD.air.most[name] > 0);
  }
}
