"use strict";
// Text that the page holds compressed: base64 of deflated UTF-8, whose length in bytes stands beside it. It is unpacked
// here and not by the browser's own streams, since these answer later than a page that goes straight to the printer can
// wait.
const unpacked = (element) => {
  const bytes = Uint8Array.from(atob(element.textContent), (character) => character.charCodeAt(0));
  return new TextDecoder().decode(inflate(bytes, new Uint8Array(Number(element.dataset.bytes))));
};
