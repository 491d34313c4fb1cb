// Runs the script of a page with the interactive plot on a document that holds what the script needs of a browser, drags
// over shares of the plot's width, and prints the labels of the axes after each drag: node trace_viewer_page.js PAGE DRAGS
const fs = require("fs"), vm = require("vm");
const page = fs.readFileSync(process.argv[2], "utf8"), drags = JSON.parse(process.argv[3]);
const script = page.match(/<script>([^]*?)<\/script>/)[1];
const elements = new Map();

function element(name) {
  if (!elements.has(name)) elements.set(name, {
    innerHTML: "", textContent: "", classList: {toggle() {}}, setAttribute() {}, querySelector: inner => element(name + inner),
    querySelectorAll: () => [], getBoundingClientRect: () => ({left: 0, width: 1120}),
  });
  return elements.get(name);
}
element("traces-data").textContent = page.match(/id="traces-data">([^]*?)<\/script>/)[1];
vm.runInNewContext(script, {document: {getElementById: element}, atob, Uint8Array, Int16Array});

const svg = element("tracessvg");
function labels() {
  const of = {value: [], residual: [], time: []};
  for (const [, x, y, text] of svg.innerHTML.matchAll(/<text x="([^"]*)" y="([^"]*)"[^>]*>([^<]*)<\/text>/g))
    if (text !== "time, ms") of[+y > 480 ? "time" : +y > 340 ? "residual" : "value"].push(text);
  return of;
}
const found = [labels()];
for (const [from, to] of drags) {
  const at = share => ({clientX: 70 + share * (1120 - 70 - 14), preventDefault() {}});
  svg.onmousedown(at(from)); svg.onmousemove(at(to)); svg.onmouseup(at(to));
  found.push(labels());
}
console.log(JSON.stringify({labels: found, reading: element("traces.reading").textContent}));
