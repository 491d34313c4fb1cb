// Measured and simulated signals of one run: choose run and signal, switch models on and off, drag to zoom, hover to read.
(function () {
  const root = document.getElementById("traces");
  const data = JSON.parse(document.getElementById("traces-data").textContent);
  const W = 1120, TOP = 330, LOW = 120, GAP = 18, L = 70, R = 14, B = 36, H = TOP + GAP + LOW + B;
  const hidden = new Set(data.hidden);
  let run = data.run, signal = data.signal, span = null;

  function numbers(packed) {
    const bytes = Uint8Array.from(atob(packed.data), c => c.charCodeAt(0));
    return Array.from(new Int16Array(bytes.buffer), v => v === -32768 ? NaN : packed.offset + packed.scale * v);
  }
  const cache = new Map();
  function series(r, s, name) {
    const key = r + "/" + s + "/" + name;
    if (!cache.has(key)) cache.set(key, numbers(data.runs[r].signals[s][name]));
    return cache.get(key);
  }
  // about `count` round numbers between two limits, at least three: multiples of 1, 2 or 5 times a power of ten
  function ticks(low, high, count) {
    if (!(high > low)) return {at: [], digits: 0};
    const raw = (high - low) / count, size = Math.pow(10, Math.floor(Math.log10(raw)));
    const multiples = step => {
      const first = Math.ceil(low / step - 1e-9), last = Math.floor(high / step + 1e-9);
      return Array.from({length: last - first + 1}, (_, k) => (first + k) * step + 0);  // + 0 turns -0 into 0
    };
    const steps = [10, 5, 2, 1, 0.5, 0.2].map(m => m * size);
    const fitting = steps.filter(s => s >= raw).pop();
    const step = steps.find(s => s <= fitting && multiples(s).length >= 3) || fitting;
    return {at: multiples(step), digits: Math.max(0, -Math.floor(Math.log10(step) + 1e-9))};
  }
  function path(x, y, inside) {
    let d = "", pen = "M";
    for (const k of inside) {
      if (isNaN(y[k])) { pen = "M"; continue; }
      d += pen + x(k).toFixed(1) + " " + y[k].toFixed(1);
      pen = "L";
    }
    return d;
  }
  function draw() {
    const current = data.runs[run], name = current.signals[signal] ? signal : Object.keys(current.signals)[0];
    const unit = data.units[name], noise = data.noise[name];
    const n = current.count, t = k => current.first + current.step * k;
    const [from, to] = span || current.shown;
    const inside = [...Array(n).keys()].filter(k => t(k) >= from && t(k) <= to);
    const measured = series(run, name, "measured");
    const models = data.models.filter(m => !hidden.has(m.name));
    const values = models.map(m => series(run, name, m.name));
    let low = Infinity, high = -Infinity, off = 3;
    for (const k of inside) for (const row of [measured, ...values]) if (!isNaN(row[k])) {
      low = Math.min(low, row[k]); high = Math.max(high, row[k]);
    }
    for (const row of values) for (const k of inside) {
      const z = Math.abs(measured[k] - row[k]) / noise;
      if (z > off) off = z;
    }
    if (low > high) low = high = 0;  // every sample is missing
    const pad = 0.06 * (high - low) || 1; low -= pad; high += pad;
    const X = v => L + (v - from) / (to - from) * (W - L - R);
    const Y = v => TOP - (v - low) / (high - low) * (TOP - 8);
    const mid = TOP + GAP + LOW / 2, Z = z => mid - z / off * (LOW / 2);
    const x = k => X(t(k));
    let out = "";
    for (const [tk, place, y] of [[ticks(low, high, 6), v => Y(v), TOP], [ticks(-off, off, 3), v => Z(v), 0]])
      for (const v of tk.at) out += `<line x1="${L}" x2="${W - R}" y1="${place(v)}" y2="${place(v)}" stroke="#e4e7eb"/>` +
        `<text x="${L - 8}" y="${place(v) + 4}" text-anchor="end">${v.toFixed(tk.digits)}</text>`;
    const tt = ticks(from, to, 8);
    for (const v of tt.at) out += `<text x="${X(v)}" y="${H - 20}" text-anchor="middle">${v.toFixed(tt.digits)}</text>`;
    out += `<text x="${(L + W) / 2}" y="${H - 4}" text-anchor="middle">time, ms</text>` +
      `<text transform="translate(14 ${TOP / 2}) rotate(-90)" text-anchor="middle">${name.replace(/_/g, " ")}, ${unit}</text>` +
      `<text transform="translate(14 ${mid}) rotate(-90)" text-anchor="middle">(model − measured) / noise</text>`;
    out += `<rect x="${L}" width="${W - L - R}" y="${Z(2)}" height="${Z(-2) - Z(2)}" fill="#e7ebef"/>`;
    const dots = inside.filter((k, i) => i % Math.max(1, Math.floor(inside.length / 700)) === 0 && !isNaN(measured[k]));
    out += `<g fill="${data.colour}" fill-opacity="0.6">` + dots.map(k => `<circle cx="${x(k).toFixed(1)}" cy="${Y(measured[k]).toFixed(1)}" r="2.2"/>`).join("") + "</g>";
    values.forEach((row, m) => {
      const pixel = row.map(Y), colour = models[m].colour;
      if (m === values.length - 1) {  // the band of noise, around the last model
        const half = 2 * noise / (high - low) * (TOP - 8);
        out += `<path d="${path(x, pixel, inside)}" fill="none" stroke="${colour}" stroke-opacity="0.25" ` +
          `stroke-width="${Math.max(2 * half, 3).toFixed(1)}"/>`;
      }
      out += `<path d="${path(x, pixel, inside)}" fill="none" stroke="${colour}" stroke-width="1.5"/>`;
      out += `<path d="${path(x, row.map((v, k) => Z((v - measured[k]) / noise)), inside)}" fill="none" ` +
        `stroke="${colour}" stroke-width="1"/>`;
    });
    out += `<rect id="traces-zoom" y="8" height="${H - B - 8}" width="0" fill="#0b62c4" fill-opacity="0.12"/>` +
      `<line id="traces-at" y1="8" y2="${H - B}" stroke="#6e7781" visibility="hidden"/>`;
    root.querySelector("svg").innerHTML = out;
    root.querySelector(".description").textContent = current.description;
    root.querySelector(".reading").textContent = "";
    const levels = current.levels[name];
    for (const m of data.models) {
      const label = root.querySelector(`[data-model="${m.name}"]`);
      label.classList.toggle("off", hidden.has(m.name));
      label.querySelector("i").textContent = levels[m.name];
    }
    root.querySelector(".run").value = run;
    root.querySelector(".signal").value = name;

    const svg = root.querySelector("svg"), time = e => {
      const box = svg.getBoundingClientRect();
      return from + ((e.clientX - box.left) / box.width * W - L) / (W - L - R) * (to - from);
    };
    let begun = null;
    svg.onmousedown = e => { begun = time(e); e.preventDefault(); };
    svg.onmousemove = e => {
      const now = time(e), k = Math.round((now - current.first) / current.step), mark = svg.querySelector("#traces-at");
      if (begun !== null) {
        const zoom = svg.querySelector("#traces-zoom");
        zoom.setAttribute("x", X(Math.min(begun, now))); zoom.setAttribute("width", Math.abs(X(now) - X(begun)));
      }
      if (k < 0 || k >= n || now < from || now > to) return;
      mark.setAttribute("x1", x(k)); mark.setAttribute("x2", x(k)); mark.setAttribute("visibility", "visible");
      const text = value => isNaN(value) ? "missing" : `${value.toPrecision(5)} ${unit}`;
      root.querySelector(".reading").textContent = `${t(k).toFixed(2)} ms: measured ${text(measured[k])}` +
        models.map((m, i) => `, ${m.name} ${text(values[i][k])}`).join("");
    };
    svg.onmouseup = e => {
      const end = time(e), apart = Math.abs(end - begun);
      if (begun !== null && apart > 3 * current.step) { span = [Math.min(begun, end), Math.max(begun, end)]; }
      begun = null; draw();
    };
    svg.ondblclick = () => { span = [t(0), t(n - 1)]; draw(); };
  }
  root.querySelector(".run").onchange = e => { run = +e.target.value; span = null; draw(); };
  root.querySelector(".signal").onchange = e => { signal = e.target.value; draw(); };
  root.querySelectorAll("[data-model]").forEach(label => label.onclick = () => {
    const name = label.dataset.model;
    if (!hidden.delete(name)) hidden.add(name);
    draw();
  });
  draw();
})();
