/* Controls that a person holds with keys and a gamepad, as the class Drive of page.py declares them. */

const DEAD = 0.12; // part of a stick's way about its middle, where it only roughly rests
const PRESSED = 0.02; // part of a trigger's way that counts

/** One control: where keys and gamepad ask it to be, and how it gets there. */
class Drive {
  /** @param {object} spec  rate, back, rest, low, high, raised_by, lowered_by, axis, button */
  constructor(spec) {
    this.spec = spec;
    this.held = false; // it is on its way, or somebody holds it
  }

  has(key) {
    return this.spec.raised_by.includes(key) || this.spec.lowered_by.includes(key);
  }

  /** Where keys ask it to be: -1 (low), 0 (rest) or 1 (high). */
  byKeys(keys) {
    const some = (list) => Number(list.some((key) => keys.has(key)));
    return some(this.spec.raised_by) - some(this.spec.lowered_by);
  }

  /** Where a gamepad has it, from -1 to 1. */
  byPad(pad) {
    if (!pad) return 0;
    const { axis, button } = this.spec,
      pressed = button === null ? 0 : (pad.buttons[button]?.value ?? 0);
    if (pressed > PRESSED) return pressed;
    const place = axis === null ? 0 : axis[1] * (pad.axes[axis[0]] ?? 0),
      size = (Math.abs(place) - DEAD) / (1 - DEAD);
    return size > 0 ? Math.sign(place) * Math.min(1, size) : 0;
  }

  /** The value some seconds later; where nobody holds it, and it is not on its way back, it stays. */
  next(value, seconds, keys, pad) {
    const { rate, back, rest, low, high } = this.spec,
      key = this.byKeys(keys),
      part = key || this.byPad(pad);
    if (!part && !this.held) return value;
    const to = rest + Math.abs(part) * ((part < 0 ? low : high) - rest),
      returns = (to - value) * (rest - value) > 0;
    const most = seconds * (key && !returns ? rate : back),
      next = Math.min(Math.max(to, value - most), value + most);
    this.held = part !== 0 || next !== rest;
    return next;
  }

  /** Keys and parts of a gamepad, for people. */
  get words() {
    const { raised_by, lowered_by, axis, button } = this.spec;
    const names = (keys) => keys.map((key) => Page.KEYS[key] || key.toUpperCase()).join(" ");
    return [
      [raised_by, lowered_by].map(names).filter(Boolean).join(" / "),
      axis === null ? "" : (Drive.AXES[axis[0]] ?? `axis ${axis[0]}`),
      button === null ? "" : (Drive.BUTTONS[button] ?? `button ${button}`),
    ]
      .filter(Boolean)
      .join(", ");
  }
}
Drive.AXES = ["left stick", "left stick", "right stick", "right stick"];
Drive.BUTTONS = { 6: "left trigger", 7: "right trigger" };

/** The keys that are held, and the gamepad that there is. */
class Hands {
  constructor() {
    this.keys = new Set();
    this.had = false;
    this.word = "";
  }

  static name(key) {
    return key.length === 1 ? key.toLowerCase() : key; // with shift it is the same key
  }

  /** Returns the gamepad with the standard layout, or null if there is none. */
  pad() {
    const pads = [...(navigator.getGamepads?.() ?? [])].filter((p) => p?.connected),
      found = pads.find((p) => p.mapping === "standard") ?? null;
    if (found) this.word = "A gamepad drives.";
    else if (this.had)
      this.word = "The gamepad is lost: what it held returns to rest.";
    else if (pads.length) this.word = `The browser does not know the layout of "${pads[0].id}", so it cannot drive.`;
    this.had = this.had || Boolean(found);
    return found;
  }
}
