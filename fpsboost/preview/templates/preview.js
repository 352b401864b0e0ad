const played = JSON.parse(document.getElementById("played").textContent);
const frames = played.frames.map((frame) => ({ ...frame, images: frame.images.map((image) => played.uris[image]) }));
const screen_ = document.querySelector(".player");
const player = new Player(screen_, { names: played.names, fps: played.fps, frames });
const passages = [...document.querySelectorAll("[data-passage]")];

for (const chip of passages) {
  chip.addEventListener("click", async () => {
    await player.stepTo(frames.findIndex((frame) => frame.passage === +chip.dataset.passage));
    player.play();
  });
}
screen_.addEventListener("shown", () => {
  const { passage } = frames[player.place];
  for (const chip of passages) chip.ariaPressed = String(+chip.dataset.passage === passage);
});
for (const button of document.querySelectorAll("[data-place]")) {
  button.addEventListener("click", () => {
    player.stepTo(+button.dataset.place);
    screen_.scrollIntoView({ block: "center" });
  });
}
document.getElementById("copy").addEventListener("click", (event) => copyText(document.getElementById("command"), event.currentTarget));
if (!matchMedia("(prefers-reduced-motion: reduce)").matches) player.play();
