// The page's own code, the same in a served and in a saved page. Bokeh draws; this chooses, shows and plays.
"use strict";
window.bow = {
  maps: [], // what is known of each run, from page.py; kept here because each callback of Bokeh gets a copy

  // Begin: show the first layer and cell.
  start(given) {
    Object.assign(bow, given); // maps, chosen, select, slider, floor
    bow.show();
    bow.chose();
    bow.keys();
  },

  // ---- the map

  // Show a layer after a test: its values, colours, colour bar and legend, in every map that has it.
  show() {
    const {maps, select, slider} = bow;
    let by_test = false;
    for (const map of maps) {
      const layer = map.layers[select.value] ?? map.layers["transient"];
      const {values} = layer.source.data;
      by_test ||= values.length > 1;
      const after = map.test_periods.findLastIndex((periods) => periods <= slider.value);
      const test = values.length > 1 ? Math.max(0, after) : 0;
      map.test = values.length > 1 ? test : map.test_periods.length - 1; // what hovering tells of
      map.now = select.value in map.layers ? select.value : "transient";
      const {palette, low, high, low_color, high_color, nan_color} = layer.mapper;
      map.mapper.setv({palette, low, high, low_color, high_color, nan_color});
      map.shown.data = {image: [values[test]]};
      for (const [name, other] of Object.entries(map.layers)) {
        if (other.bar !== null) other.bar.visible = name === map.now;
      }
      const when = values.length > 1 ? ` after ${map.test_periods[test]} periods` : "";
      map.title.text = map.prefix + layer.title + when + layer.unit;
      map.legend.text = layer.legends[test];
    }
    slider.disabled = !by_test;
  },

  // The cell under a place in the map, or -1.
  cell_at(map, x, y) {
    const [ny, nx] = map.shape;
    const ix = Math.floor(x), iy = Math.floor(y);
    return ix >= 0 && ix < nx && iy >= 0 && iy < ny ? iy * nx + ix : -1;
  },

  // Choose a cell of one map, and the nearest one of the other.
  choose(run, cell) {
    if (cell < 0) return;
    const cells = bow.maps.map((map, other) => other === run ? cell : bow.maps[run].nearest[other][cell]);
    bow.chosen.data = {cell: cells};
  },

  tap(run, x, y) {
    bow.choose(run, bow.cell_at(bow.maps[run], x, y));
  },

  // A cell is chosen in every map: mark it, describe it, and in a saved page show its samples.
  chose() {
    bow.maps.forEach((map, run) => {
      const cell = bow.chosen.data.cell[run], nx = map.shape[1];
      map.marker.data = {x: [cell % nx + 0.5], y: [Math.floor(cell / nx) + 0.5]};
      map.details.text = bow.details(map, cell);
      if (map.packed) bow.unpack(map, cell);
    });
  },

  // Arrow keys go to the neighbouring cell of the first map.
  keys() {
    const steps = {ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowDown: [0, -1], ArrowUp: [0, 1]};
    document.addEventListener("keydown", (event) => {
      const step = steps[event.key], within = event.composedPath()[0];
      if (step === undefined || event.ctrlKey || event.altKey || event.metaKey || event.shiftKey) return;
      if (["INPUT", "SELECT", "TEXTAREA"].includes(within.tagName) || within.role === "slider") return;
      if (within.classList?.contains("noUi-handle")) return;
      const nx = bow.maps[0].shape[1], cell = bow.chosen.data.cell[0];
      event.preventDefault();
      bow.tap(0, cell % nx + step[0], Math.floor(cell / nx) + step[1]);
    });
  },

  // What hovering says of a cell: `what` is the name of a line.
  hover(run, what, x, y) {
    const map = bow.maps[run], cell = map ? bow.cell_at(map, x, y) : -1;
    if (cell < 0) return "";
    const [ny, nx] = map.shape;
    if (what === "x") return bow.number(map.x[cell % nx]) + map.x_units[cell % nx];
    if (what === "y") return bow.number(map.y[Math.floor(cell / nx)]) + map.y_units[Math.floor(cell / nx)];
    const at = (name) => {
      const values = map.layers[name]?.source.data.values;
      return values === undefined ? NaN : values[values.length > 1 ? map.test : 0][cell];
    };
    if (what === "regime") return map.regime_names[at("regime")] ?? (map.predicted?.[cell] ? "predicted" : "not computed");
    if (what === "confidence") return Number.isFinite(at("confidence")) ? at("confidence").toFixed(2) : "not known";
    if (what === "transient") return bow.length(at("transient"));
    if (what === "test") {
      return bow.number(at("correlation")) + ", " + bow.number(at("slips")) + ", " + bow.number(at("corners"));
    }
    if (what === "difference") return bow.difference(at("difference"), map.layers.difference.mapper);
    if (what === "terrain") return map.terrain_names[at("terrain")] ?? "not computed";
    return "";
  },

  length(periods) {
    return Number.isNaN(periods) ? "not computed" : periods > 0 ? bow.number(periods) + " periods" : "never Helmholtz motion";
  },

  difference(periods, {low, high}) {
    if (Number.isNaN(periods)) return "not computed";
    if (periods > high) return "Helmholtz motion in B only";
    if (periods < low) return "Helmholtz motion in A only";
    return periods < -high ? "never in both" : `${periods > 0 ? "+" : ""}${bow.number(periods)} periods`;
  },

  // When Helmholtz motion came, after the name of the regime at the end.
  came(regime, periods) {
    if (Number.isNaN(periods)) return "";
    if (!(periods > 0)) return ", never Helmholtz motion";
    return (regime === "Helmholtz" ? " after " : ", Helmholtz motion came after ") + bow.number(periods) + " periods";
  },

  number(value) {
    return Number.isFinite(value) ? String(parseFloat(Number(value).toPrecision(4))) : "not known";
  },

  // ---- one cell of a saved page

  // Put the last periods of a cell into its plots.
  unpack(map, cell) {
    const packed = map.packed.data, samples = map.samples;
    const small = bow.part(packed.force[0], cell * samples, (cell + 1) * samples);
    const middle = packed.middle[0][cell], step = packed.step[0][cell];
    const force = Float32Array.from(small, (value) => middle + step * value);
    const time = Float64Array.from(small, (_, sample) => (map.first + sample) / map.period);
    map.wave.data = {time, force};
    const from = packed.offset[0][cell], to = packed.offset[0][cell + 1];
    const left = Array.from(bow.part(packed.onset[0], from, to), (onset) => (map.first + onset) / map.period);
    const right = left.map((start, slip) => start + packed.duration[0][from + slip] / map.period);
    map.slips.data = {left, right};
    const known = packed.period[0][cell];
    const period = known > 0 ? known : map.period;
    map.heard = {force, period, rate: map.rate};
    const moves = small.some((value) => value !== 0);
    const [spectrum, harmonics] = moves ? bow.spectra(force, period, map.rate) : [bow.none(), bow.none()];
    map.spectrum.data = spectrum;
    map.harmonics.data = harmonics;
  },

  // A part of one of Bokeh's arrays as a plain one: theirs do not know subarray().
  part(array, from, to) {
    const kinds = {int8: Int8Array, int16: Int16Array, uint16: Uint16Array, uint32: Uint32Array};
    return new kinds[array.dtype](array.buffer, array.byteOffset + from * array.BYTES_PER_ELEMENT, to - from);
  },

  none() {
    return {frequency: [], level: []};
  },

  // Amplitude spectrum (Hann window, mean removed) and harmonics of the last whole periods, dB; 0 dB is an amplitude of 1.
  spectra(force, period, rate) {
    const count = Math.max(1, Math.floor(force.length / period));
    const tail = force.subarray(force.length - Math.min(force.length, Math.round(count * period)));
    const mean = tail.reduce((sum, value) => sum + value, 0) / tail.length;
    const window = Float64Array.from(tail, (_, n) => 0.5 - 0.5 * Math.cos(2 * Math.PI * n / tail.length));
    const area = window.reduce((sum, value) => sum + value, 0);
    const amplitude = (cycles) => { // at so many cycles a sample
      let re = 0, im = 0;
      for (let n = 0; n < tail.length; n++) {
        const angle = 2 * Math.PI * cycles * n, value = (tail[n] - mean) * window[n];
        re += value * Math.cos(angle);
        im -= value * Math.sin(angle);
      }
      return 2 * Math.hypot(re, im) / area;
    };
    const levels = (cycles) => {
      const size = cycles.map(amplitude), most = Math.max(...size, 1e-9);
      return {
        frequency: cycles.map((value) => value * rate / 1000),
        level: size.map((value) => 20 * Math.log10(Math.max(value, most * 10 ** (-bow.floor / 20)))),
      };
    };
    const lines = Array.from({length: 2 * tail.length}, (_, line) => line / (4 * tail.length));
    const multiples = Array.from({length: Math.floor(0.5 * period - 1e-9)}, (_, n) => (n + 1) / period);
    return [levels(lines), levels(multiples)];
  },

  details(map, cell) {
    const [ny, nx] = map.shape, last = map.test_periods.length - 1, layers = map.layers;
    const at = (name) => {
      const values = layers[name]?.source.data.values;
      return values === undefined ? NaN : values[values.length - 1][cell];
    };
    const code = at("regime");
    const words = {
      x: bow.number(map.x[cell % nx]) + map.x_units[cell % nx],
      y: bow.number(map.y[Math.floor(cell / nx)]) + map.y_units[Math.floor(cell / nx)],
      regime: map.regime_names[code] ?? (map.predicted?.[cell] ? "not simulated in this run, predicted" : "not computed"),
      colour: map.regime_colours[code] ?? "#969696",
      confidence: Number.isFinite(at("confidence")) ? ` (confidence ${at("confidence").toFixed(2)})` : "",
      transient: bow.came(map.regime_names[code], at("transient")),
    };
    return map.details_form.replace(/\{(\w+)\}/g, (_, name) => words[name] ?? "");
  },

  // ---- sound

  context: null,
  source: null,
  sound: null, // the latest sound, {samples, rate}

  // Browsers allow sound only after a click: the context is made in the click itself.
  ready() {
    bow.context ??= new AudioContext({sampleRate: 48000});
    if (bow.context.state === "suspended") bow.context.resume();
    return bow.context;
  },

  play(samples) {
    const context = bow.ready();
    bow.source?.stop();
    const buffer = context.createBuffer(1, Math.max(1, samples.length), 48000);
    buffer.copyToChannel(samples, 0);
    bow.source = new AudioBufferSourceNode(context, {buffer});
    bow.source.connect(context.destination);
    bow.source.start();
    bow.sound = {samples, rate: buffer.sampleRate};
  },

  // A saved page: the last periods as one loop, made into a sound by the browser's own synthesis, which is band-limited.
  async play_loop(run, seconds) {
    bow.ready();
    const {heard} = bow.maps[run];
    const rate = 48000, {loop, periods} = bow.loop(heard.force, heard.period);
    const count = Math.floor(loop.length / 2), real = new Float32Array(count), imag = new Float32Array(count);
    for (let n = 1; n < count; n++) {
      for (let at = 0; at < loop.length; at++) {
        const angle = 2 * Math.PI * n * at / loop.length;
        real[n] += 2 * loop[at] * Math.cos(angle) / loop.length;
        imag[n] += 2 * loop[at] * Math.sin(angle) / loop.length;
      }
    }
    const offline = new OfflineAudioContext(1, Math.round(seconds * rate), rate);
    const wave = offline.createPeriodicWave(real, imag, {disableNormalization: true});
    const tone = new OscillatorNode(offline, {type: "custom", periodicWave: wave, frequency: heard.rate / (periods * heard.period)});
    const gain = offline.createGain();
    gain.gain.setValueAtTime(0, 0);
    gain.gain.linearRampToValueAtTime(1, 0.005);
    gain.gain.setValueAtTime(1, seconds - 0.03);
    gain.gain.linearRampToValueAtTime(0, seconds - 1 / rate);
    tone.connect(gain).connect(offline.destination);
    tone.start();
    const samples = (await offline.startRendering()).getChannelData(0);
    const most = samples.reduce((peak, value) => Math.max(peak, Math.abs(value)), 0);
    bow.play(most > 1e-9 ? samples.map((value) => value / most * 10 ** (-3 / 20)) : new Float32Array(samples.length));
  },

  // Whole periods at the end of a waveform, whose end is faded into what comes before their beginning: no click.
  loop(force, period) {
    const periods = Math.max(1, Math.floor(force.length / period) - 1);
    const length = Math.min(force.length, Math.round(periods * period)), start = force.length - length;
    const fade = Math.min(start, Math.round(period)), loop = Float64Array.from(force.subarray(start));
    for (let n = 0; n < fade; n++) {
      const rise = 0.5 - 0.5 * Math.cos(Math.PI * (n + 0.5) / fade);
      loop[length - fade + n] = force[start + length - fade + n] * (1 - rise) + force[start - fade + n] * rise;
    }
    return {loop, periods};
  },
};
