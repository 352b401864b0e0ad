const byId = (id) => document.getElementById(id);
const form = byId("form");
/** Names in the form of the kinds of streams that are kept. */
const KEPT = { audio: "sound", subtitle: "subtitles" };
const state = { clip: null, clips: [], player: null, folder: "", entries: [] };

class Notice extends Error {}

/** A question that another one has replaced. */
class Dropped extends Error {}

// ---------------------------------------------------------------- the server

const KEPT_AS = "fpsboost-token";
let token = "";

/** The token as all tabs of this browser keep it; a browser may keep nothing. */
function keptToken(given) {
  try {
    if (given) localStorage.setItem(KEPT_AS, given);
    return localStorage.getItem(KEPT_AS) ?? "";
  } catch (error) {
    return "";
  }
}

/** Take the token from the address, which forgets it, or the one that a tab has kept, and say whether the server knows it. */
async function enter() {
  const given = location.hash.slice(1);
  if (given) history.replaceState(null, "", location.pathname);
  for (const each of new Set([given, keptToken(), token])) {
    if (!each || !(await fetch("/jobs", { headers: { "X-Fpsboost-Token": each } }).catch(() => null))?.ok) continue;
    const isOther = token && token !== each;
    token = each;
    keptToken(each); // only now, so that no address of another page can replace a right one
    if (isOther) for (const clip of state.clips) await ask("/pick", { path: clip.choices.input }); // the server was started again
    return true;
  }
  return false;
}

/** Ask the server; what is wrong with the question becomes a notice. */
async function ask(path, data, signal) {
  let answer, found;
  try {
    answer = await fetch(path, {
      signal,
      method: data === undefined ? "GET" : "POST",
      headers: { "X-Fpsboost-Token": token, "Content-Type": "application/json" },
      body: data === undefined ? undefined : JSON.stringify(data),
    });
    found = answer.status === 403 ? {} : await answer.json(); // which a server that is being stopped does not send
  } catch (error) {
    if (signal?.aborted) throw new Dropped();
    throw new Notice("fpsboost does not answer; start fpsboost ui again, then this page goes on.");
  }
  if (signal?.aborted) throw new Dropped();
  if (answer.status === 403 && token !== keptToken() && (await enter())) return ask(path, data, signal);
  byId("stranger").hidden = answer.status !== 403;
  if (answer.status === 403) throw new Notice("This page does not belong to the fpsboost that runs.");
  if (!answer.ok) throw new Notice(found.notice ?? `The server answered ${answer.status}.`);
  return found;
}

const asked = {};

/** Ask what replaces an earlier question of its kind, for whose answer the page then waits no longer. */
function askAnew(kind, path, data) {
  asked[kind]?.abort();
  asked[kind] = new AbortController();
  return ask(path, data, asked[kind].signal);
}

/** Show a sentence in a section, or hide the last one. */
function say(section, sentence = "") {
  const place = section.querySelector(".notice");
  place.textContent = sentence;
  place.hidden = !sentence;
}

/** Do something, and show in a section why it cannot be done. */
async function attempt(section, action) {
  try {
    say(section);
    return await action();
  } catch (error) {
    if (error instanceof Notice) say(section, error.message);
    else if (!(error instanceof Dropped)) throw error;
    return undefined;
  }
}

/** What happened elsewhere on the page than where the focus is, for those who do not see it. */
function announce(sentence) {
  byId("news").textContent = sentence;
}

/** Do something unless the button says that it cannot be done; a disabled one would lose the focus. */
function onPress(button, action) {
  button.addEventListener("click", () => button.ariaDisabled === "true" || action());
}

function make(name, properties = {}, ...children) {
  const element = Object.assign(document.createElement(name), properties);
  element.append(...children);
  return element;
}

// ---------------------------------------------------------------- the clip

const icons = {
  folder: "M1.5 4.5v8h13v-7h-7l-1.5-2h-4.5z",
  clip: "M1.5 3.5h13v9h-13zM6.5 6v4l3.5-2z",
};

function icon(kind) {
  const svg = document.createElementNS("http://www.w3.org/2000/svg", "svg");
  svg.setAttribute("viewBox", "0 0 16 16");
  svg.setAttribute("aria-hidden", "true");
  const path = document.createElementNS("http://www.w3.org/2000/svg", "path");
  path.setAttribute("d", icons[kind]);
  svg.append(path);
  return svg;
}

function size(bytes) {
  const units = ["B", "kB", "MB", "GB", "TB"];
  let place = 0;
  for (; bytes >= 1000 && place < units.length - 1; place++) bytes /= 1000;
  return `${bytes.toFixed(bytes < 10 && place ? 1 : 0)} ${units[place]}`;
}

async function open(path) {
  const found = await askAnew("choice", "/folder", { path });
  const focused = document.activeElement.closest("#entries, #above")?.id;
  Object.assign(state, { folder: found.path, entries: found.entries });
  if (path || !byId("path").value) byId("path").value = found.path; // what was typed meanwhile stays
  const crumbs = found.above.map((each, place) => {
    const button = make("button", { type: "button", textContent: each.name });
    if (place === found.above.length - 1) button.setAttribute("aria-current", "page");
    button.addEventListener("click", () => attempt(byId("choose"), () => open(each.path)));
    return button;
  });
  byId("above").replaceChildren(...crumbs.flatMap((each, place) => (place > 1 ? [make("span", {}, "/"), each] : [each])));
  const entries = found.entries.map((each) => {
    const button = make("button", { type: "button", className: each.kind }, icon(each.kind));
    button.append(make("span", { className: "name" }, each.name));
    if (each.kind === "clip") button.append(make("small", {}, size(each.size)));
    const isClip = each.kind === "clip";
    button.addEventListener("click", () => attempt(byId("choose"), () => (isClip ? pick([each.path]) : open(each.path))));
    if (!isClip) return make("li", {}, button);
    const tick = make("input", { type: "checkbox", value: each.path, ariaLabel: `Tick ${each.name}` });
    tick.addEventListener("change", countTicks);
    return make("li", {}, make("label", {}, tick), button);
  });
  if (found.left_out) entries.push(make("li", { className: "empty" }, `${found.left_out} more; type the path.`));
  if (!entries.length) entries.push(make("li", { className: "empty" }, "No folders and no videos here."));
  byId("entries").replaceChildren(...entries);
  byId("entries").scrollTop = 0;
  const clips = found.entries.filter((each) => each.kind === "clip").length;
  const isLong = byId("entries").scrollHeight > byId("entries").clientHeight;
  const counts = [counted(found.entries.length - clips, "folder"), counted(clips, "clip")].filter((each) => !each.startsWith("0"));
  byId("count").textContent = counts.length ? `${counts.join(", ")}${isLong ? "; scroll for more" : ""}.` : "";
  countTicks();
  byId("images").hidden = found.images < 2;
  byId("images").textContent = `Use the ${found.images} images in this folder`;
  if (focused === "entries") (byId("entries").querySelector("button") ?? byId("entries")).focus();
  if (focused === "above") byId("above").lastElementChild.focus();
}

function counted(count, what) {
  return `${count} ${what}${count === 1 ? "" : "s"}`;
}

function ticked() {
  return [...byId("entries").querySelectorAll(":checked")].map((each) => each.value);
}

function countTicks() {
  const count = ticked().length;
  byId("take").hidden = !count;
  byId("take").textContent = count === 1 ? "Use the ticked clip" : `Use these ${count} clips`;
}

/** A path that was typed: a folder is opened, anything else is picked. */
async function openOrPick(path) {
  try {
    await open(path);
  } catch (error) {
    if (!(error instanceof Notice)) throw error;
    await pick([path]);
  }
}

/** Take clips that become something alike; the first one is shown. Of two choices at a time, the last one counts. */
async function pick(paths) {
  const clips = [];
  for (const path of paths) clips.push(await askAnew("choice", "/pick", { path }));
  for (const clip of clips) {
    clip.streams = clip.streams.filter((each) => each.kind in KEPT).map((each) => ({ ...each, kind: KEPT[each.kind], what: described(each) }));
  }
  state.clips = clips;
  byId("choose").hidden = true;
  for (const id of ["clip", "how", "look"]) byId(id).hidden = false;
  byId("clip-title").textContent = clips.length > 1 ? `${clips.length} clips` : clips[0].name;
  byId("several").hidden = clips.length === 1;
  const chips = clips.map((clip) => {
    const chip = make("button", { type: "button", className: "chip", role: "radio", textContent: clip.name });
    chip.addEventListener("click", () => showClip(clip));
    return chip;
  });
  byId("several").replaceChildren(...chips);
  fill(clips);
  byId("clip-title").focus({ preventScroll: true });
  byId("clip-title").scrollIntoView({ block: "nearest" });
  showClip(clips[0]);
  check();
}

/** Show one of the clips that were taken. */
function showClip(clip) {
  if (clip === state.clip) return;
  asked.probe?.abort(); // a clip that is no longer shown is not read on
  Object.assign(state, { clip, player: null, looking: null });
  choose([...byId("several").children], (_, place) => state.clips[place] === clip);
  byId("says").textContent = `${clip.says}.`;
  byId("notes").replaceChildren(...clip.remarks.map((each) => make("p", { className: "note" }, each)));
  byId("facts").hidden = true;
  byId("reading").hidden = true;
  byId("picture").replaceChildren();
  showStreams();
  setLast(clip);
  goTo((clip.last ?? 0) / 2);
  byId("read").hidden = clip.is_quick;
  if (clip.is_quick) probe();
}

function fill(clips) {
  form.reset();
  state.isNamed = false;
  const [{ choices, is_images: isImages }] = clips;
  form.elements.name.value = choices.name;
  byId("folder").textContent = choices.folder;
  for (const id of ["name", "where"]) byId(id).hidden = clips.length > 1;
  byId("names").hidden = clips.length === 1;
  byId("input-fps").hidden = !isImages;
  showOwn();
  suggestName();
}

async function probe() {
  const { clip } = state;
  if (document.activeElement === byId("read")) byId("clip-title").focus();
  byId("read").hidden = true;
  byId("reading").hidden = false;
  const found = await attempt(byId("clip"), () => askAnew("probe", "/probe", { path: clip.choices.input }));
  if (clip === state.clip) byId("reading").hidden = true;
  if (!found) return;
  const streams = found.streams.map((each) => [`stream ${each.index}`, described(each)]);
  const rows = [...Object.entries(found.facts), ...streams].map(([name, value]) =>
    make("div", {}, make("dt", {}, name), make("dd", {}, value)),
  );
  setLast(found);
  byId("facts").lastElementChild.replaceChildren(...rows);
  byId("facts").hidden = false;
  byId("notes").replaceChildren(...found.remarks.map((each) => make("p", { className: "note" }, each)));
}

// ---------------------------------------------------------------- what it becomes

/** The form for a clip; of several, each has a name of its own, beside its source. */
function choices(clip = state.clip) {
  const { elements } = form;
  const [rate, value] = elements.kind.value.split(":");
  return {
    ...clip.choices,
    rate,
    value: value ?? elements.value.value.trim(),
    loop: elements.loop.checked,
    method: elements.method.value,
    start: elements.start.value.trim(),
    end: elements.end.value.trim(),
    codec: elements.codec.value,
    quality: elements.quality.value,
    ...keptOf(clip),
    overwrite: elements.overwrite.checked,
    name: state.clips.length > 1 ? nameFor(clip) : elements.name.value.trim(),
    is_named: state.isNamed && !state.isTaken, // if not, the answer says which name is free
    input_fps: elements.input_fps.value.trim(),
  };
}

function described({ kind, codec, details, language, title }) {
  return `${kind}: ${[codec, details, language === "und" ? "" : language, title].filter(Boolean).join(" ")}`;
}

/** Which sound and subtitles are kept of a clip. */
function keptOf({ streams }) {
  const { elements } = form;
  const kept = streams.filter((each) => !each.isDropped && elements[each.kind].checked);
  const keeps = (kind) => elements[kind].checked && (kept.some((each) => each.kind === kind) || !streams.some((each) => each.kind === kind));
  const hasChoice = streams.some((each) => each.isDropped);
  return { sound: keeps("sound"), subtitles: keeps("subtitles"), streams: hasChoice ? kept.map((each) => each.index).join(",") : "" };
}

/** Offer the sound and subtitles of the clip that is shown, where there are several of a kind. */
function showStreams() {
  const { clip, clips } = state;
  for (const kind of ["sound", "subtitles"]) {
    form.elements[kind].parentElement.hidden = !clips.some((each) => each.streams.some((stream) => stream.kind === kind));
  }
  byId("streams").hidden = new Set(clip.streams.map((each) => each.kind)).size === clip.streams.length;
  byId("streams-title").textContent = clips.length > 1 ? `Streams to keep of ${clip.name}` : "Streams to keep";
  const ticks = clip.streams.map((each) => {
    const tick = make("input", { type: "checkbox", checked: !each.isDropped, disabled: !form.elements[each.kind].checked });
    tick.addEventListener("input", () => (each.isDropped = !tick.checked));
    return make("label", { className: "check" }, tick, make("span", {}, `${each.index}: ${each.what}`));
  });
  byId("streams").lastElementChild.replaceChildren(...ticks);
}

/** The name that says what a clip becomes. */
function nameFor(clip) {
  const [rate, value = form.elements.value.value.trim()] = form.elements.kind.value.split(":");
  const end = { factor: `${value}x`, fps: `${value}fps`, slow: `slow-${value}x`, retime: "ramp" }[rate];
  return /^[\d.]+$/.test(value) || rate === "retime" ? clip.choices.name.replace(/-2x(-\d+)?(?=[./][^/]*$)/, `-${end}`) : clip.choices.name;
}

/** The name follows what the clip becomes, until the user writes another. */
function suggestName() {
  if (!state.isNamed) form.elements.name.value = nameFor(state.clips[0]);
}

function showOwn() {
  const [rate, value] = form.elements.kind.value.split(":");
  const words = { factor: "Times as many frames", fps: "Frames a second", slow: "Times as long", retime: "Output = source" };
  const isOther = byId("own").hidden || byId("own").dataset.kind !== rate; // what is typed now is not replaced
  byId("own").hidden = value !== undefined;
  byId("own").dataset.kind = rate;
  byId("own").firstElementChild.textContent = words[rate];
  const input = form.elements.value;
  if (isOther && (rate === "retime") !== input.value.includes("=")) input.value = "";
  const end = Math.floor(length() * 1000) / 1000, half = Math.round(end * 5) / 10; // the second half at half speed, to its end
  if (isOther) input.value ||= rate === "retime" ? curveText([[0, 0], [half, half], [half + 2 * (end - half), end]]) : rate === "fps" ? "50" : "3";
  input.inputMode = rate === "retime" ? "text" : "decimal";
  byId("ramp").hidden = rate !== "retime";
  if (rate === "retime") drawCurve();
}

// ---------------------------------------------------------------- speed ramp

/** Length of the clip, seconds; a guess if it is not known, or counted in images. */
function length() {
  return state.length && !state.clip.is_images ? state.length : 4;
}

/** Points of a curve in seconds; null if it is written in other units. */
function pointsOf(text) {
  const words = text.trim().split(/\s+/).filter((word) => word !== "smooth");
  const points = words.map((word) => /^(0|\d*\.?\d+(?=s))s?=(0|\d*\.?\d+(?=s))s?$/.exec(word)?.slice(1).map(Number));
  return points.length > 1 && points.every(Boolean) ? points : null;
}

function curveText(points) {
  const seconds = (value) => `${Math.round(value * 1000) / 1000}s`;
  return [...(byId("smooth").checked ? ["smooth"] : []), ...points.map((point) => point.map(seconds).join("="))].join(" ");
}

function setCurve(points, place) {
  form.elements.value.value = curveText(points);
  form.elements.value.dispatchEvent(new Event("input", { bubbles: true }));
  byId("ramp").querySelectorAll("circle")[place]?.focus();
}

/** Draw the curve with its points, which pointer and arrow keys move between their neighbours. */
function drawCurve() {
  const svg = byId("ramp").querySelector("svg"), points = pointsOf(form.elements.value.value);
  svg.toggleAttribute("hidden", !points);
  if (points) byId("smooth").checked = /\bsmooth\b/.test(form.elements.value.value);
  if (!points || state.drags) return points && place(points);
  const draw = (name, attributes) => {
    const element = document.createElementNS("http://www.w3.org/2000/svg", name);
    for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
    return element;
  };
  const dots = points.map((_, number) => {
    const dot = draw("circle", { r: 7, tabindex: 0, role: "slider" });
    dot.addEventListener("keydown", (event) => {
      const step = event.shiftKey ? 1 : 0.1;
      const [x, y] = { ArrowLeft: [-step, 0], ArrowRight: [step, 0], ArrowUp: [0, step], ArrowDown: [0, -step] }[event.key] ?? [0, 0];
      const now = pointsOf(form.elements.value.value);
      if (x || y) move(now, number, now[number][0] + x, now[number][1] + y);
      else if (event.key === "Delete" && now.length > 2) setCurve(now.filter((_, each) => each !== number), Math.max(0, number - 1));
      else return;
      event.preventDefault();
    });
    dot.addEventListener("pointerdown", (event) => {
      dot.setPointerCapture(event.pointerId);
      state.drags = scaleOf(points); // the scale stays while a point is dragged
    });
    dot.addEventListener("pointermove", (event) => {
      if (!state.drags) return;
      const box = svg.getBoundingClientRect();
      const [x, y] = [((event.clientX - box.left) / box.width) * 360, ((event.clientY - box.top) / box.height) * 200];
      const { end, top } = state.drags;
      move(pointsOf(form.elements.value.value), number, ((x - 34) / 310) * end, ((176 - y) / 160) * top);
    });
    for (const name of ["pointerup", "pointercancel"]) {
      dot.addEventListener(name, () => {
        state.drags = null;
        drawCurve();
        byId("ramp").querySelectorAll("circle")[number]?.focus();
      });
    }
    return dot;
  });
  const texts = ["end", "middle", "end", "start"].map((anchor) => draw("text", { "text-anchor": anchor }));
  svg.replaceChildren(draw("path", { d: "M34 16V176H344" }), draw("path", { class: "line" }), ...texts, ...dots);
  place(points);
}

function scaleOf(points) {
  return { end: points.at(-1)[0] * 1.15, top: Math.max(length(), ...points.map((point) => point[1])) };
}

/** Slopes of a monotone cubic at its points, as in fpsboost/media/time_map.py. */
function slopesOf(points) {
  const widths = points.slice(1).map(([x], k) => x - points[k][0]);
  const rises = points.slice(1).map(([, y], k) => (y - points[k][1]) / widths[k]);
  const endSlope = ([h0, h1], [d0, d1]) => {
    if (d1 === undefined) return d0;
    const slope = d0 + ((d0 - d1) * h0) / (h0 + h1);
    if (slope * d0 <= 0) return 0;
    return d0 * d1 <= 0 && Math.abs(slope) > 3 * Math.abs(d0) ? 3 * d0 : slope;
  };
  const inner = rises.slice(1).map((after, k) => {
    const before = rises[k], [h0, h1] = [widths[k], widths[k + 1]];
    return before * after > 0 ? (3 * (h0 + h1)) / ((h0 + 2 * h1) / before + (2 * h0 + h1) / after) : 0;
  });
  return [endSlope(widths, rises), ...inner, endSlope(widths.toReversed(), rises.toReversed())];
}

/** Put line, points and labels where they belong. */
function place(points) {
  const svg = byId("ramp").querySelector("svg"), { end, top } = state.drags ?? scaleOf(points);
  const at = points.map(([x, y]) => [34 + (x / end) * 310, 176 - (y / top) * 160]);
  const slopes = byId("smooth").checked ? slopesOf(at) : [];
  const parts = at.slice(1).map(([x1, y1], k) => {
    const [x0, y0] = at[k], third = (x1 - x0) / 3;
    return slopes.length ? `C${x0 + third} ${y0 + third * slopes[k]} ${x1 - third} ${y1 - third * slopes[k + 1]} ${x1} ${y1}` : `L${x1} ${y1}`;
  });
  svg.querySelector(".line").setAttribute("d", `M${at[0].join(" ")}${parts.join("")}`);
  const labels = [[30, 20, `${top.toFixed(1)} s`], [189, 194, "output"], [344, 190, `${end.toFixed(1)} s`], [38, 11, "source"]];
  svg.querySelectorAll("text").forEach((text, number) => {
    const [x, y, words] = labels[number];
    text.setAttribute("x", x);
    text.setAttribute("y", y);
    text.textContent = words;
  });
  svg.querySelectorAll("circle").forEach((dot, number) => {
    const [x, y] = points[number].map((value) => Math.round(value * 1000) / 1000);
    dot.setAttribute("cx", at[number][0]);
    dot.setAttribute("cy", at[number][1]);
    dot.setAttribute("aria-label", `Point ${number + 1}`);
    dot.setAttribute("aria-valuenow", y);
    dot.setAttribute("aria-valuetext", `at ${x} s of the output, ${y} s of the source`);
  });
}

/** Move a point; output times keep their order, the first one stays at 0, and no time leaves the clip. */
function move(points, number, x, y) {
  const last = number ? points[number - 1][0] : 0, next = number ? points[number + 1]?.[0] ?? Infinity : 0;
  const gap = Math.min(0.05, (next - last) / 4), before = number ? last + gap : 0, after = next - gap;
  points[number] = [Math.min(Math.max(x, before), after), Math.min(Math.max(y, 0), length())];
  setCurve(points, number);
}

byId("add-point").addEventListener("click", () => {
  const points = pointsOf(form.elements.value.value) ?? [[0, 0], [1, 1]];
  const [x, y] = points.at(-1), [x0, y0] = points.at(-2);
  setCurve([...points.slice(0, -1), [(x0 + x) / 2, (y0 + y) / 2], points.at(-1)], points.length - 1);
});
byId("smooth").addEventListener("input", () => {
  const points = pointsOf(form.elements.value.value);
  if (points) setCurve(points, -1);
});

let checks = 0;
let soon;

/** Say what the conversion would give, or why it cannot be done, once the user pauses. */
function check() {
  clearTimeout(soon);
  const number = ++checks;
  soon = setTimeout(async () => {
    byId("outcome").textContent = "";
    const answer = await attempt(form, () => askAnew("check", "/check", chosen()));
    if (number !== checks) return;
    byId("start").ariaDisabled = String(!answer);
    if (!answer) return;
    const found = answer.clips;
    const remarks = new Set(found.flatMap((each) => each.remarks));
    const outcomes = found.map((each, place) => make("p", {}, named(place, outcomeOf(each))));
    byId("outcome").replaceChildren(...outcomes, ...[...remarks].map((each) => make("p", { className: "note" }, each)));
    const words = found.map((each) => each.command).join("\n").split(/([ \n])/); // none is broken at its hyphens
    byId("command").replaceChildren(...words.map((word) => (/[ \n]/.test(word) ? word : make("span", {}, word))));
    byId("names").textContent = `Each beside its source: ${found.map((each) => each.name).join(", ")}.`;
    if (!state.isNamed || state.isTaken) form.elements.name.value = found[0].name;
    state.isTaken = false;
  }, 250);
}

function chosen() {
  return { clips: state.clips.map((clip) => choices(clip)) };
}

function named(place, sentence) {
  return state.clips.length > 1 ? `${state.clips[place].name}: ${sentence}` : sentence;
}

function outcomeOf({ frames, rate, length }) {
  const says = [frames ? `${frames.toLocaleString("en")} frames` : "the number of frames is unknown"];
  if (rate) says.push(`at ${+rate.toFixed(3)} a second`);
  if (length) says.push(`${length} long`);
  return `${says.join(", ")}.`;
}

form.addEventListener("input", (event) => {
  if (event.target.name === "name") Object.assign(state, { isNamed: true, isTaken: false });
  showOwn();
  suggestName();
  check();
  if (event.target.name === "method") look();
  if (["sound", "subtitles"].includes(event.target.name)) showStreams();
});
form.addEventListener("submit", async (event) => {
  event.preventDefault();
  if (byId("start").ariaDisabled === "true") return;
  byId("start").ariaDisabled = "true";
  const added = await attempt(form, () => ask("/add", chosen()));
  byId("start").ariaDisabled = "false";
  if (added) {
    state.isTaken = true;
    suggestName();
    check();
  }
  await follow();
  if (!added) return;
  const count = added.numbers.length;
  announce(count > 1 ? `${count} conversions were added to the queue.` : "The conversion was added to the queue.");
  byId("queue").scrollIntoView({ block: "nearest" });
});

// ---------------------------------------------------------------- one frame

/** A place as it is written: a time, or the number of an image. */
function clock(seconds) {
  if (state.clip.is_images) return `${Math.round(seconds) + 1}`;
  const whole = Math.floor(seconds / 60);
  return `${whole}:${(seconds - 60 * whole).toFixed(3).padStart(6, "0")}`;
}

/** Let the slider reach to the last position; if that is not known, it is hidden until the clip was read, and positions are typed. */
function setLast({ last, length }) {
  Object.assign(state, { last, length });
  byId("time").parentElement.hidden = last === null;
  byId("time").max = last ?? 0;
}

function goTo(seconds) {
  if (state.last === null) byId("time").max = seconds;
  byId("time").value = seconds;
  byId("at").value = clock(+byId("time").value);
  look();
}

/** Show the frame at the chosen position; while one of the same clip is made, only the last wish after it counts. */
async function look() {
  if (state.looking) {
    state.looking.again = true;
    return;
  }
  const { clip } = state, looking = (state.looking = { again: false });
  byId("between").textContent = "Interpolating…";
  state.player?.element.classList.add("is-busy");
  const wish = choices();
  const question = { choices: { ...clip.choices, method: wish.method }, time: +byId("time").value };
  const found = await attempt(byId("look"), () => askAnew("look", "/look", question));
  if (looking !== state.looking) return; // another clip is shown, and this one dropped
  state.looking = null;
  if (found) await picture(found, wish.method);
  else byId("between").textContent = "";
  if (looking.again) look();
}

async function decoded(src) {
  const image = make("img", { src });
  await image.decode();
  return image;
}

async function picture(found, method) {
  const data = { names: ["blending", method], fps: 1, uris: found.images, frames: [{ number: 0, passage: 0, images: [0, 1] }] };
  if (method === "blend") { // there is nothing to compare it with, so no divider
    state.player = null;
    byId("picture").replaceChildren(Object.assign(await decoded(found.images[1]), { alt: "The two frames, mixed" }));
  } else if (!state.player) {
    const { naturalWidth: width, naturalHeight: height } = await decoded(found.images[0]);
    const element = byId("player").content.firstElementChild.cloneNode(true);
    element.style.setProperty("--width", width);
    element.style.setProperty("--height", height);
    Object.assign(element.querySelector("canvas"), { width, height });
    byId("picture").replaceChildren(element);
    state.player = new Player(element, data);
  } else {
    state.player.take(data);
    state.player.show(0);
    state.player.restyle();
  }
  state.player?.element.classList.remove("is-busy");
  const cut = found.is_cut ? " A scene ends between these two; the method repeats the nearer one." : "";
  byId("between").textContent = `In the middle ${found.between}.${cut}`;
}

byId("time").addEventListener("input", () => (byId("at").value = clock(+byId("time").value)));
byId("time").addEventListener("change", () => goTo(+byId("time").value));
byId("at").addEventListener("change", () => {
  const { clip } = state;
  attempt(byId("look"), async () => {
    const { time } = await askAnew("place", "/place", { path: clip.choices.input, text: byId("at").value });
    if (clip === state.clip) goTo(time);
  });
});

// ---------------------------------------------------------------- the queue

function left(job) {
  const seconds = (job.frames - job.frame) / job.fps;
  if (seconds < 90) return `${Math.ceil(seconds)} s left`;
  return seconds < 5400 ? `${Math.round(seconds / 60)} min left` : `${(seconds / 3600).toFixed(1)} h left`;
}

function stateOf(job) {
  const frames = job.frames ? `${job.frame.toLocaleString("en")} of ${job.frames.toLocaleString("en")} frames` : `${job.frame} frames`;
  if (job.state === "running") {
    if (!job.fps) return "Starting";
    return [frames, `${job.fps.toFixed(1)} a second`, ...(job.frames ? [left(job)] : [])].join(", ");
  }
  const words = { waiting: "Waits for the one before", stopping: "Stopping", paused: job.message || "Paused", done: frames, failed: "Failed" };
  return words[job.state];
}

const actions = {
  running: [["pause", "Pause"], ["remove", "Cancel"]],
  waiting: [["pause", "Pause"], ["remove", "Cancel"]],
  stopping: [],
  paused: [["resume", "Continue"], ["remove", "Cancel"]],
  failed: [["resume", "Try again"], ["remove", "Remove"]],
  done: [["show", "Show in folder"], ["remove", "Remove"]],
};

const shownStates = new Map();

function show(job) {
  let item = byId(`job-${job.number}`);
  if (!item) {
    item = byId("job").content.firstElementChild.cloneNode(true);
    item.id = `job-${job.number}`;
    const name = job.output.split(/[\\/]/).filter(Boolean).at(-1);
    item.querySelector("h3").textContent = name;
    item.querySelector("h3").title = job.output;
    item.querySelector("progress").setAttribute("aria-label", `Progress of ${name}`);
    byId("jobs").append(item);
  }
  const bar = item.querySelector("progress");
  bar.hidden = job.state === "done";
  bar.value = job.frames ? job.frame / job.frames : 0;
  item.querySelector(".state").textContent = stateOf(job);
  item.querySelector(".said").textContent = [job.state === "paused" ? "" : job.message, ...job.remarks].filter(Boolean).join(" ");
  if (shownStates.get(job.number) === job.state) return;
  const isNew = !shownStates.has(job.number);
  shownStates.set(job.number, job.state);
  item.className = `is-${job.state}`;
  const name = item.querySelector("h3").textContent;
  if (!isNew) announce(`${name}: ${[stateOf(job), job.state === "failed" ? job.message : ""].filter(Boolean).join(". ")}`);
  const old = [...item.querySelector(".actions").children];
  if (job.state === "stopping") return old.forEach((button) => (button.ariaDisabled = "true"));
  const buttons = actions[job.state].map(([action, label]) => {
    const button = make("button", { type: "button", className: "chip", textContent: label });
    button.setAttribute("aria-label", `${label} ${name}`);
    onPress(button, () => change(job.number, action, button));
    return button;
  });
  const place = old.indexOf(document.activeElement);
  item.querySelector(".actions").replaceChildren(...buttons);
  if (place >= 0) buttons[Math.min(place, buttons.length - 1)].focus();
  item.querySelector(".result").replaceChildren(...(job.state === "done" ? result(job) : []));
}

/** What a job has written, beside its source, which plays in step. */
function result(job) {
  const where = make("p", { className: "note" }, `Saved as ${job.output}`);
  if (/[\\/]$/.test(job.output)) return [where, still(job)];
  const after = pictureOf(job, "result", job.output);
  const before = pictureOf(job, "source", job.words[1]);
  if (after.localName === "video" && before.localName === "video") playInStep(after, before, job.words);
  const figure = (element, label) => make("figure", {}, element, make("figcaption", {}, label));
  return [where, make("div", { className: "beside" }, figure(before, "Before"), figure(after, "After"))];
}

let turn = Promise.resolve();

/** Load one thing after the other, but wait for none for ever: all of a page has six connections to a server. */
function inTurn(load) {
  turn = turn.then(() => Promise.race([load(), new Promise((resolve) => setTimeout(resolve, 20_000))])).catch(() => {});
}

function loadInTurn(element, src) {
  const loaded = (resolve) => {
    for (const name of ["load", "loadedmetadata", "error"]) element.addEventListener(name, resolve, { once: true });
    element.src = src;
  };
  inTurn(() => new Promise(loaded));
}

/** A frame of what cannot be played here. */
function still(job) {
  const image = make("img", { alt: "A frame of the result" });
  image.addEventListener("error", () => image.remove());
  loadInTurn(image, job.media.poster);
  return image;
}

/** A frame of a video until it is played. */
async function setPoster(video, src) {
  const answer = await fetch(src);
  if (!answer.ok) return; // then it has none
  const reader = new FileReader();
  reader.addEventListener("load", () => (video.poster = reader.result));
  reader.readAsDataURL(await answer.blob());
}

function pictureOf(job, kind, path) {
  const isImage = /\.(gif|webp|png|apng)$/i.test(path);
  const element = isImage ? make("img", { alt: `The ${kind}` }) : make("video", { controls: kind === "result", loop: job.words.includes("--loop"), preload: "metadata" });
  if (!isImage && kind === "result") inTurn(() => setPoster(element, job.media.poster));
  loadInTurn(element, job.media[kind]);
  element.addEventListener("error", () => {
    if (kind === "source") element.closest("figure").remove(); // images, and what only other players play
    else element.replaceWith(still(job), make("p", { className: "note" }, "This browser cannot play it; other players can."));
  });
  return element;
}

/** Let the source, without sound, follow what is done with the result: the same part of it, as slow as the result. */
function playInStep(after, before, words) {
  const option = (name) => words[words.indexOf(name) + 1 || words.length];
  const slow = words.includes("--slow-motion") ? +option("--factor") || 1 : 1;
  const seconds = (text) => text.split(":").reduce((sum, part) => 60 * sum + +part, 0);
  const [start, end] = [option("--start"), option("--end")];
  /** Where the part begins; of frames, whose rate nobody here knows, its length says so. */
  const begin = () => {
    if (!start?.endsWith("f")) return start ? seconds(start) : 0;
    const length = after.duration / slow;
    if (end?.endsWith("f")) return (parseInt(start) * length) / (parseInt(end) - parseInt(start));
    return (end ? seconds(end) : before.duration) - length;
  };
  let isNew = true; // until it is played or moved, the result shows its poster, which is the frame in its middle
  const place = () => begin() + (isNew ? after.duration / 2 : after.currentTime) / slow;
  const align = () => {
    if (Number.isFinite(place()) && Math.abs(before.currentTime - place()) > (after.paused ? 0.001 : 0.1)) before.currentTime = place();
  };
  before.muted = true;
  for (const name of ["play", "seeking"]) after.addEventListener(name, () => ((isNew = false), align()));
  after.addEventListener("play", () => before.play().catch(() => {})); // a pause that follows at once
  for (const name of ["pause", "ended"]) after.addEventListener(name, () => before.pause());
  for (const name of ["loadedmetadata", "seeking", "seeked", "pause", "timeupdate"]) after.addEventListener(name, align);
  before.addEventListener("loadedmetadata", align);
  const pace = () => (before.playbackRate = Math.max(0.0625, after.playbackRate / slow));
  after.addEventListener("ratechange", pace);
  pace();
}

async function change(number, action, button) {
  button.ariaDisabled = "true";
  await attempt(byId("queue"), () => ask("/change", { number, action }));
  button.ariaDisabled = "false"; // unless it is another one now
  await follow();
}

let next;
let isLost = false;

/** Show the queue, again and again, as another tab may change it; more often while something in it moves. */
async function follow() {
  clearTimeout(next);
  let jobs;
  try {
    jobs = await ask("/jobs");
    if (isLost) say(byId("queue"));
    isLost = false; // else the notice is about what was done to a job, and stays
  } catch (error) {
    if (!(error instanceof Notice)) throw error;
    say(byId("queue"), error.message);
    isLost = true;
    next = setTimeout(follow, 3000); // it may be started again
    return;
  }
  const numbers = new Set(jobs.map((job) => `job-${job.number}`));
  for (const item of [...byId("jobs").children]) {
    if (numbers.has(item.id)) continue;
    shownStates.delete(+item.id.slice(4));
    const beside = item.nextElementSibling ?? item.previousElementSibling;
    if (item.contains(document.activeElement)) (beside?.querySelector("h3") ?? byId("queue-title")).focus();
    item.remove();
  }
  byId("none").hidden = jobs.length > 0;
  jobs.forEach(show);
  const moves = jobs.some((job) => ["running", "waiting", "stopping"].includes(job.state));
  next = setTimeout(follow, moves ? 500 : 2000);
}

// ---------------------------------------------------------------- the page

byId("path-form").addEventListener("submit", (event) => {
  event.preventDefault();
  attempt(byId("choose"), () => openOrPick(byId("path").value.trim()));
});
byId("images").addEventListener("click", () => attempt(byId("choose"), () => pick([state.folder])));
byId("take").addEventListener("click", () => attempt(byId("choose"), () => pick(ticked())));
byId("another").addEventListener("click", () => {
  for (const id of ["clip", "how", "look"]) byId(id).hidden = true;
  byId("choose").hidden = false;
  const place = state.entries.findIndex((each) => each.path === state.clips[0].choices.input);
  (byId("entries").children[place]?.querySelector("button") ?? byId("path")).focus();
});

/** A browser tells names and sizes of dropped files, but not where they lie: the server looks for them. */
async function drop(files) {
  if (!files.length) throw new Notice("Only files can be dropped here; drop videos.");
  const wanted = [...files].map(({ name, size }) => ({ name, size }));
  const { paths, missing } = await ask("/find", { folder: state.folder, files: wanted });
  if (paths.length) await pick(paths);
  if (missing.length) throw new Notice(`A browser does not tell where ${missing.join(", ")} lies; open its folder here and drop it again, or type its path.`);
}

for (const name of ["dragenter", "dragover"]) {
  addEventListener(name, (event) => {
    if (!event.dataTransfer.types.includes("Files")) return;
    event.preventDefault();
    document.body.classList.add("is-dropping");
  });
}
addEventListener("dragleave", (event) => event.relatedTarget || document.body.classList.remove("is-dropping"));
addEventListener("drop", (event) => {
  event.preventDefault();
  document.body.classList.remove("is-dropping");
  attempt(byId(byId("choose").hidden ? "clip" : "choose"), () => drop(event.dataTransfer.files));
});
byId("read").addEventListener("click", probe);
document.documentElement.classList.add("scripted");

/** Go on with another token: this page was opened by it, or another tab. */
async function begin() {
  await enter();
  if (!state.folder) await attempt(byId("choose"), () => open(""));
  if (state.clip) check();
  await follow();
}

addEventListener("hashchange", begin);
addEventListener("storage", begin);
byId("again").addEventListener("click", begin);
begin();
