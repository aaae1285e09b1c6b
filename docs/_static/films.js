/* Animated pictures: a button stops each of them. Those of cards move only while the card has the pointer or the focus. Where less
   motion is preferred, cards stay still, and other films until their button is pressed. A canvas with the first picture covers a
   film that stands still. */
(() => {
  const calm = matchMedia("(prefers-reduced-motion: reduce)").matches;

  function prepare(picture) {
    const film = document.createElement("span"), cover = document.createElement("canvas");
    film.className = "film";
    cover.width = picture.naturalWidth;
    cover.height = picture.naturalHeight;
    cover.setAttribute("aria-hidden", "true"); // the picture below has the text
    picture.replaceWith(film);
    film.append(picture, cover);
    const move = (moving) => {
      if (!moving) cover.getContext("2d").drawImage(picture, 0, 0);
      cover.hidden = moving;
    };
    const card = film.closest(".cards > li");
    if (!card) {
      const button = document.createElement("button");
      button.type = "button";
      const set = (moving) => { move(moving); button.textContent = moving ? "Stop film" : "Play film"; };
      button.addEventListener("click", () => set(!cover.hidden));
      film.append(button);
      set(!calm);
    } else {
      move(false);
      if (calm) return;
      for (const [name, moving] of [["pointerenter", true], ["focusin", true], ["pointerleave", false], ["focusout", false]])
        card.addEventListener(name, () => move(moving));
    }
  }

  for (const picture of document.querySelectorAll('article img[src$=".gif"], article img[src$=".webp"]')) {
    if (picture.complete && picture.naturalWidth) prepare(picture);
    else picture.addEventListener("load", () => prepare(picture), { once: true });
  }
})();
