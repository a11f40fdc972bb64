// Who and what: chosen from the studies and from what was recorded. A new one is asked for.
import { $, el, fill } from "./console.js";

const groups = { experiment: "In this experiment", study: "In a study", recorded: "Recorded before" };
const NEW = "+";

// `id` is the field's for a new name, `id`-of the list's; `id`-new and `id`-list stand around them. `changed` is
// called when the name is another one.
export function naming(id, another, changed = () => {}) {
  const list = $(`${id}-of`), field = $(id), chosen = () => list.value !== NEW;
  const value = () => (chosen() ? list.value : field.value);
  const show = () => {
    $(`${id}-new`).classList.toggle("hidden", chosen());
    field.disabled = chosen(); // or the browser refuses the form, without a word
  };
  list.addEventListener("change", () => { show(); if (!chosen()) field.focus(); changed(); });
  field.addEventListener("input", changed);
  return {
    value,
    choose(name) {
      list.value = [...list.options].some((one) => one.value === name) ? name : NEW;
      if (!chosen()) field.value = name;
      show();
      changed();
    },
    offer(names) {
      const before = value(), known = new Set();
      const asked = list.value === NEW && !list.disabled; // the operator is about to write it
      const options = (all) => all.filter((name) => !known.has(name) && known.add(name)).map((name) => el("option", { value: name }, name));
      const made = Object.entries(groups).map(([kind, label]) => el("optgroup", { label }, ...options(names[kind] || [])));
      fill(list, el("option", { value: "", disabled: true, hidden: true }, "Choose ..."), ...made.filter((group) => group.children.length), el("option", { value: NEW }, another));
      list.value = known.has(before) ? before : before || asked || !known.size ? NEW : "";
      list.disabled = !known.size;
      $(`${id}-list`).classList.toggle("hidden", !known.size);
      show();
      if (value() !== before) changed();
    },
  };
}
