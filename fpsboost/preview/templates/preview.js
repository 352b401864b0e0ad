const player = new Player(document.querySelector(".player"));
const passages = all("[data-passage]");

for (const chip of passages) {
  chip.addEventListener("click", async () => {
    await player.stepTo(player.frames.findIndex((frame) => frame.passage === +chip.dataset.passage));
    player.play();
  });
}
player.element.addEventListener("shown", () => {
  const { passage } = player.frames[player.place];
  choose(passages, (chip) => +chip.dataset.passage === passage);
});
for (const button of all("[data-place]")) {
  button.addEventListener("click", () => {
    player.stepTo(+button.dataset.place);
    player.element.scrollIntoView({ block: "center" });
  });
}
document.getElementById("copy").addEventListener("click", (event) => copyText(document.getElementById("command"), event.currentTarget));
if (!matchMedia("(prefers-reduced-motion: reduce)").matches) player.play();
