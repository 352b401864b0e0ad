const token = new URLSearchParams(location.search).get("token") ?? "";
const byId = (id) => document.getElementById(id);
const form = byId("form");
const state = { choices: null, clip: null, player: null, folder: "" };

class Notice extends Error {}

/** Ask the server; what is wrong with the question becomes a notice. */
async function ask(path, data, signal) {
  let answer;
  try {
    answer = await fetch(path, {
      signal,
      method: data === undefined ? "GET" : "POST",
      headers: { "X-Fpsboost-Token": token, "Content-Type": "application/json" },
      body: data === undefined ? undefined : JSON.stringify(data),
    });
  } catch (error) {
    throw new Notice("fpsboost does not answer; start fpsboost ui again, and open the address that it prints.");
  }
  const found = await answer.json();
  if (!answer.ok) throw new Notice(found.notice ?? `The server answered ${answer.status}.`);
  return found;
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
    if (!(error instanceof Notice)) throw error;
    say(section, error.message);
    return undefined;
  }
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
  const found = await ask("/folder", { path });
  state.folder = found.path;
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
    const action = each.kind === "clip" ? pick : open;
    button.addEventListener("click", () => attempt(byId("choose"), () => action(each.path)));
    return make("li", {}, button);
  });
  if (found.left_out) entries.push(make("li", { className: "empty" }, `${found.left_out} more; type the path.`));
  if (!entries.length) entries.push(make("li", { className: "empty" }, "No folders and no videos here."));
  byId("entries").replaceChildren(...entries);
  byId("entries").scrollTop = 0;
  byId("images").hidden = found.images < 2;
  byId("images").firstElementChild.textContent = `Take the ${found.images} images of this folder`;
}

/** A path that was typed: a folder is opened, anything else is picked. */
async function openOrPick(path) {
  try {
    await open(path);
  } catch (error) {
    if (!(error instanceof Notice)) throw error;
    await pick(path);
  }
}

async function pick(path) {
  const clip = await ask("/pick", { path });
  state.reading?.abort(); // a clip that is no longer shown is not read on
  byId("reading").hidden = true;
  Object.assign(state, { clip, choices: clip.choices, player: null });
  byId("choose").hidden = true;
  byId("clip-title").textContent = clip.name;
  byId("says").textContent = `${clip.says}.`;
  byId("facts").replaceChildren(...clip.remarks.map((each) => make("p", {}, each)));
  fill(clip);
  for (const id of ["clip", "how", "look"]) byId(id).hidden = false;
  byId("picture").replaceChildren();
  setLast(clip.last);
  goTo((clip.last ?? 0) / 2);
  byId("read").hidden = clip.is_quick;
  if (clip.is_quick) probe();
  byId("clip-title").scrollIntoView({ block: "nearest" });
  check();
}

function fill(clip) {
  form.reset();
  state.isNamed = false;
  form.elements.name.value = clip.choices.name;
  byId("folder").textContent = clip.choices.folder;
  byId("input-fps").hidden = !clip.is_images;
  showOwn();
}

async function probe() {
  const { clip } = state;
  state.reading = new AbortController();
  byId("read").hidden = true;
  byId("reading").hidden = false;
  await attempt(byId("clip"), async () => {
    try {
      const found = await ask("/probe", { path: clip.choices.input }, state.reading.signal);
      if (state.clip !== clip) return;
      const rows = Object.entries(found.facts).map(([name, value]) =>
        make("div", {}, make("dt", {}, name), make("dd", {}, value)),
      );
      found.streams.forEach((each, place) => rows.push(make("div", {}, make("dt", {}, `stream ${place}`), make("dd", {}, each))));
      setLast(found.last);
      byId("facts").replaceChildren(make("dl", {}, ...rows), ...found.remarks.map((each) => make("p", {}, each)));
    } catch (error) {
      if (state.clip === clip) throw error;
    }
  });
  if (state.clip === clip) byId("reading").hidden = true;
}

// ---------------------------------------------------------------- what it becomes

function choices() {
  const { elements } = form;
  const [rate, value] = elements.kind.value.split(":");
  return {
    ...state.choices,
    rate,
    value: value ?? elements.value.value.trim(),
    method: elements.method.value,
    start: elements.start.value.trim(),
    end: elements.end.value.trim(),
    codec: elements.codec.value,
    quality: elements.quality.value,
    sound: elements.sound.checked,
    subtitles: elements.subtitles.checked,
    overwrite: elements.overwrite.checked,
    name: elements.name.value.trim(),
    is_named: state.isNamed && !state.isTaken, // if not, the answer says which name is free
    input_fps: elements.input_fps.value.trim(),
  };
}

/** The name follows what the clip becomes, until the user writes another. */
function suggestName() {
  const { rate, value } = choices();
  const end = { factor: `${value}x`, fps: `${value}fps`, slow: `slow-${value}x` }[rate];
  if (state.isNamed || !/^[\d.]+$/.test(value)) return;
  form.elements.name.value = state.choices.name.replace(/-2x(-\d+)?(?=[./][^/]*$)/, `-${end}`);
}

function showOwn() {
  const [rate, value] = form.elements.kind.value.split(":");
  const words = { factor: "Times as many frames", fps: "Frames a second", slow: "Times as long" };
  byId("own").hidden = value !== undefined;
  byId("own").firstElementChild.textContent = words[rate];
  form.elements.value.value ||= rate === "fps" ? "50" : "3";
}

let checks = 0;
let soon;

/** Say what the conversion would give, or why it cannot be done, once the user pauses. */
function check() {
  clearTimeout(soon);
  const number = ++checks;
  soon = setTimeout(async () => {
    byId("outcome").textContent = "";
    const found = await attempt(form, () => ask("/check", choices()));
    if (number !== checks) return;
    byId("start").disabled = !found;
    if (!found) return;
    const says = [found.frames ? `${found.frames.toLocaleString("en")} frames` : "frames as many as there are"];
    if (found.rate) says.push(`at ${+found.rate.toFixed(3)} a second`);
    if (found.length) says.push(`${found.length} long`);
    byId("outcome").textContent = [`${says.join(", ")}.`, ...found.remarks].join(" ");
    byId("command").textContent = found.command;
    if (!state.isNamed || state.isTaken) form.elements.name.value = found.name;
    state.isTaken = false;
  }, 250);
}

form.addEventListener("input", (event) => {
  if (event.target.name === "name") Object.assign(state, { isNamed: true, isTaken: false });
  showOwn();
  suggestName();
  check();
  if (event.target.name === "method") look();
});
form.addEventListener("submit", async (event) => {
  event.preventDefault();
  byId("start").disabled = true;
  state.isTaken = !!(await attempt(form, () => ask("/add", choices())));
  byId("start").disabled = false;
  suggestName();
  check();
  await follow();
  byId("queue").scrollIntoView({ block: "nearest" });
});

// ---------------------------------------------------------------- one frame

/** A place as it is written: a time, or the number of an image. */
function clock(seconds) {
  if (state.clip.is_images) return `${Math.round(seconds) + 1}`;
  const whole = Math.floor(seconds / 60);
  return `${whole}:${(seconds - 60 * whole).toFixed(3).padStart(6, "0")}`;
}

/** Let the slider reach to the last place; if that is not known, it is hidden until the clip was read, and places are typed. */
function setLast(last) {
  state.last = last;
  byId("time").parentElement.hidden = last === null;
  byId("time").max = last ?? 0;
}

function goTo(seconds) {
  if (state.last === null) byId("time").max = seconds;
  byId("time").value = seconds;
  byId("at").value = clock(+byId("time").value);
  look();
}

let looking = false;
let lookAgain = false;

/** Show the frame at the chosen place; while one is made, only the last wish after it counts. */
async function look() {
  if (looking) {
    lookAgain = true;
    return;
  }
  looking = true;
  const { clip } = state;
  byId("between").textContent = "Making it… the first time, code is compiled for this machine.";
  state.player?.element.classList.add("is-busy");
  const wish = choices();
  const found = await attempt(byId("look"), () => ask("/look", { choices: { ...clip.choices, method: wish.method }, time: +byId("time").value }));
  looking = false;
  if (found && clip === state.clip) await picture(found, wish.method);
  else byId("between").textContent = "";
  if (lookAgain) {
    lookAgain = false;
    look();
  }
}

async function decoded(src) {
  const image = make("img", { src });
  await image.decode();
  return image;
}

async function picture(found, method) {
  const data = { names: ["blending", method], fps: 1, uris: found.images, frames: [{ number: 0, passage: 0, images: [0, 1] }] };
  if (!state.player) {
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
  state.player.element.classList.remove("is-busy");
  const cut = found.is_cut ? " A scene ends between these two; the method repeats the nearer one." : "";
  byId("between").textContent = `In the middle ${found.between}.${cut}`;
}

byId("time").addEventListener("input", () => (byId("at").value = clock(+byId("time").value)));
byId("time").addEventListener("change", () => goTo(+byId("time").value));
byId("at").addEventListener("change", () => {
  const parts = byId("at").value.split(":").map(Number);
  const place = parts.reduce((sum, part) => 60 * sum + part, 0);
  if (parts.every(Number.isFinite)) goTo(state.clip.is_images ? place - 1 : place);
  else say(byId("look"), `${byId("at").value} is no place in a clip; write 90.5 or 1:30.5.`);
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
    if (job.stage === "compiling") return "Compiling for this machine, once";
    if (!job.fps) return "Starting";
    return [frames, `${job.fps.toFixed(1)} a second`, ...(job.frames ? [left(job)] : [])].join(", ");
  }
  const words = { waiting: "Waits for the one before", stopping: "Stopping", paused: job.message || "Paused", done: frames, failed: "Not done" };
  return words[job.state];
}

const actions = {
  running: [["pause", "Pause"], ["remove", "Cancel"]],
  waiting: [["pause", "Pause"], ["remove", "Cancel"]],
  stopping: [],
  paused: [["resume", "Continue"], ["remove", "Cancel"]],
  failed: [["resume", "Try again"], ["remove", "Remove"]],
  done: [["remove", "Remove"]],
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
  shownStates.set(job.number, job.state);
  item.className = `is-${job.state}`;
  const name = item.querySelector("h3").textContent;
  const buttons = actions[job.state].map(([action, label]) => {
    const button = make("button", { type: "button", className: "chip", textContent: label });
    button.setAttribute("aria-label", `${label} ${name}`);
    button.addEventListener("click", () => change(job.number, action, button));
    return button;
  });
  item.querySelector(".actions").replaceChildren(...buttons);
  item.querySelector(".result").replaceChildren(...(job.state === "done" ? [result(job)] : []));
}

function result(job) {
  const address = `/result/${job.number}?token=${encodeURIComponent(token)}`;
  const where = make("p", { className: "note" }, `It is ${job.output}`);
  if (/\.(gif|webp|png|apng)$/i.test(job.output)) return make("div", {}, where, make("img", { src: address, alt: "The result" }));
  if (/[\\/]$/.test(job.output)) return where;
  const video = make("video", { src: address, controls: true, muted: true, preload: "metadata" });
  video.addEventListener("error", () => video.replaceWith(make("p", { className: "note" }, "This browser cannot play it; other players do.")));
  return make("div", {}, where, video);
}

async function change(number, action, button) {
  button.disabled = true;
  await attempt(byId("queue"), () => ask("/change", { number, action }));
  await follow();
}

let next;

/** Show the queue, again and again, as another tab may change it; more often while something in it moves. */
async function follow() {
  clearTimeout(next);
  const jobs = await attempt(byId("queue"), () => ask("/jobs"));
  if (!jobs) {
    next = setTimeout(follow, 3000); // it may be started again
    return;
  }
  const numbers = new Set(jobs.map((job) => `job-${job.number}`));
  for (const item of [...byId("jobs").children]) {
    if (numbers.has(item.id)) continue;
    shownStates.delete(+item.id.slice(4));
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
byId("images").firstElementChild.addEventListener("click", () => attempt(byId("choose"), () => pick(state.folder)));
byId("another").addEventListener("click", () => {
  for (const id of ["clip", "how", "look"]) byId(id).hidden = true;
  byId("choose").hidden = false;
  byId("path").focus();
});
byId("read").addEventListener("click", probe);
document.documentElement.classList.add("scripted");
attempt(byId("choose"), () => open(""));
follow();
