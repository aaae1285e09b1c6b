/* The list of versions, in the sidebar. versions.js of the site's root, which is loaded before, sets VIBGYM_VERSIONS. */
(() => {
  const list = document.querySelector(".versions select"), root = document.documentElement.dataset.content_root;
  for (const name of window.VIBGYM_VERSIONS ?? []) list.add(new Option(name, name));
  list.value = list.dataset.version;
  list.addEventListener("change", async () => {
    const other = `${root}../${list.value}/`, page = other + list.dataset.page;
    const served = location.protocol !== "file:"; // local files cannot be looked for
    const found = served && await fetch(page, { method: "HEAD" }).then((answer) => answer.ok, () => false);
    location.assign(found ? page : `${other}index.html`);
  });
})();
