// A form of a TOML file, drawn from the JSON schema of its model. It changes `values` in place; what they mean is judged
// by the file's loader, and by nothing here.
import { el, fill } from "./console.js";

// Keys that a kind of experiment has no use for.
const only = { identify: ["identification"], answers: ["identification"], pairs: ["rating"], scale: ["rating"], comparison: ["two-interval", "staircase"], levels: ["two-interval"] };
for (const name of ["start", "step", "halvings", "down", "reversals", "max_trials", "highest"]) only[name] = ["staircase"];

export function form(schema, values, changed) {
  let number = 0;
  const resolve = (one) => {
    const options = (one.anyOf || [one]).filter((option) => option.type !== "null");
    const found = options.length > 1 ? { choice: options } : options[0];
    const at = found.$ref ? schema.$defs[found.$ref.split("/").pop()] : found;
    return { ...at, description: one.description || at.description, default: one.default };
  };
  const words = (name) => { const said = name.replaceAll("_", " "); return said[0].toUpperCase() + said.slice(1); };
  const hint = (text) => (text ? [el("p", { class: "note" }, text.replace(/; see .*$/, ".").replaceAll("`", ""))] : []);
  const used = (name, section) => !only[name] || section.title === "Factor" || only[name].includes(values.kind);

  // The fields of a table; what is empty or the default stands in no file.
  function fields(section, table) {
    return Object.entries(section.properties).filter(([name]) => used(name, section)).map(([name, given]) => {
      const one = resolve(given), put = (value) => { if (value === undefined || value === "" || JSON.stringify(value) === JSON.stringify(one.default)) delete table[name]; else table[name] = value; changed(); };
      if (one.properties) return part(words(name), one, table, name);
      if (one.type === "array" && resolve(one.items || {}).properties) return several(words(name), one, table, name);
      return field(words(name), one, table[name] ?? one.default, put, name);
    });
  }
  function part(label, one, table, name) {
    const inner = table[name] ?? {};
    table[name] = inner;
    return el("details", { open: Object.keys(inner).length > 0 }, el("summary", {}, label), ...fields(one, inner));
  }
  function several(label, one, table, name) {
    const place = el("div", {}), model = resolve(one.items), all = table[name] ??= [];
    let open = -1; // the one that was added or moved
    const drawn = () => fill(place, ...all.map((inner, k) => el("details", { open: k === open }, el("summary", {}, `${label} ${k + 1}${inner.name ? `: ${inner.name}` : ""}`), ...fields(model, inner),
      el("div", { class: "row" }, button("Duplicate", () => { all.splice(open = k + 1, 0, { ...structuredClone(inner), name: `${inner.name} 2` }); }), button("Remove", () => { all.splice(k, 1); open = -1; }), ...(k ? [button("Up", () => all.splice(open = k - 1, 0, ...all.splice(k, 1)))] : [])))),
      el("div", { class: "row" }, button(`Add a ${label.toLowerCase()}`, () => { open = all.push({ name: "" }) - 1; })));
    const button = (text, act) => el("button", { type: "button", onclick: () => { act(); drawn(); changed(); } }, text);
    drawn();
    return place;
  }

  function field(label, one, value, put, name) {
    const id = `field-${++number}`, named = (control) => el("div", {}, el("label", { for: id }, label), control, ...hint(one.description));
    const listed = (options, chosen) => {
      const select = el("select", { id, onchange: () => { put(options[select.selectedIndex][1]); } }, ...options.map(([text]) => el("option", {}, text)));
      select.selectedIndex = Math.max(0, options.findIndex(([, each]) => JSON.stringify(each) === JSON.stringify(chosen)));
      return named(select);
    };
    if (one.enum) return listed(one.enum.map((each) => [each, each]), value);
    if (one.choice) return listed([["no", false], ["yes", true], ...levels(value).map(([factor, level]) => [`only where ${factor} is ${level}`, { [factor]: level }])], value);
    if (one.type === "boolean") {
      const box = el("input", { id, type: "checkbox", checked: value, onchange: () => put(box.checked) });
      return el("div", {}, el("label", { class: "check" }, box, label), ...hint(one.description));
    }
    const [text, read] = written(one, resolve), lines = one.type === "object" || (one.items && one.items.prefixItems);
    const box = el(lines ? "textarea" : "input", { id, autocomplete: "off", oninput: () => put(read(box.value)) });
    box.value = value === undefined || value === null ? "" : text(value);
    if (lines) box.rows = Math.max(2, box.value.split("\n").length);
    if (name === "name") box.required = true;
    return named(box);
  }
  // Levels of the factors that vary by session, on which feedback may depend.
  function levels(value) {
    const found = (values.factor || []).filter((one) => one.varies === "session").flatMap((one) => (one.levels || []).map((level) => [one.name, level]));
    return value && typeof value === "object" && !found.length ? Object.entries(value) : found;
  }
  return fields(schema, values);
}

// How a value stands in a field, and is read from it: names with commas, a line for each pair or key.
const number = (text) => (text.trim() && Number.isFinite(Number(text)) ? Number(text) : text.trim());
const split = (text, by = ",") => text.split(by).map((one) => one.trim()).filter(Boolean);
const some = (found) => (found.length ? found : undefined);
function written(one, resolve) {
  const item = one.items || (one.prefixItems || [])[0] || {};
  if (one.type === "array" && item.prefixItems) return [(all) => all.map((pair) => pair.join(", ")).join("\n"), (text) => some(split(text, "\n").map((line) => split(line)))];
  if (one.type === "array") return [(all) => all.join(", "), (text) => some(item.type === "string" ? split(text) : split(text).map(number))];
  if (one.type === "object") return [(all) => dotted(all).join("\n"), (text) => keys(split(text, "\n"), one, resolve)];
  return [String, ["number", "integer"].includes(one.type) ? number : (text) => text];
}

// A table of names: "latch = latch.h5"; one of tables: "P01.age = 31". A text that would be read as another kind of value
// stands in quotes: "P01.code = "007"".
function dotted(table, before = "") {
  return Object.entries(table).flatMap(([name, value]) => (value && typeof value === "object" && !Array.isArray(value) ? dotted(value, `${before}${name}.`) : [`${before}${name} = ${shown(value)}`]));
}
const shown = (value) => (Array.isArray(value) ? value.join(", ") : typeof value === "string" && plain(value) !== value ? JSON.stringify(value) : `${value}`);
function plain(text) {
  if (["true", "false"].includes(text)) return text === "true";
  if (!/^".*"$/.test(text)) return number(text);
  try { return JSON.parse(text); } catch (error) { return text; }
}
// A value is of the kind that the model states for its key; where it states none, a comma makes no list.
function keys(lines, model, resolve) {
  const found = {};
  for (const line of lines) {
    const [left, ...right] = line.split("="), text = right.join("=").trim(), texts = model.additionalProperties.type === "string", path = texts ? [left.trim()] : split(left, ".");
    let table = found, one = model;
    for (const name of path) one = resolve((one.properties || {})[name] || (typeof one.additionalProperties === "object" ? one.additionalProperties : {}));
    for (const name of path.slice(0, -1)) table = table[name] = Object.hasOwn(table, name) && typeof table[name] === "object" ? table[name] : {};
    table[path.at(-1)] = one.type === "array" ? split(text).map(number) : one.type === "string" ? text : plain(text);
  }
  return lines.length ? found : undefined;
}
