/** Copy the text of an element; a browser that does not let a page do so gets it selected. */
async function copyText(element, button) {
  try {
    await navigator.clipboard.writeText(element.innerText);
    button.textContent = "Copied";
  } catch (error) {
    getSelection().selectAllChildren(element);
  }
}
