/* Of every page: the switch of light and dark, and copying. */

const all = (selector, within = document) => [...within.querySelectorAll(selector)];

document.querySelector(".theme").addEventListener("click", () => {
  const root = document.documentElement;
  const dark = root.dataset.theme ? root.dataset.theme === "dark" : matchMedia("(prefers-color-scheme: dark)").matches;
  root.dataset.theme = dark ? "light" : "dark";
  try {
    localStorage.setItem("fpsboost-theme", root.dataset.theme);
  } catch (error) {
    // a browser that keeps nothing shows it all the same
  }
});

/** Copy the text of an element; a browser that does not let a page do so gets it selected. */
async function copyText(element, button) {
  try {
    await navigator.clipboard.writeText(element.innerText);
    button.textContent = "Copied";
  } catch (error) {
    getSelection().selectAllChildren(element);
  }
}
