// How long something takes, as a range in words.
import { get } from "./console.js";

// Seconds of a press, from the newest recordings; null where that cannot be told.
export const pace = () => get("/api/pace").catch(() => null);

export function span({ low_s, high_s }, times = 1) {
  const low = low_s * times, high = high_s * times, both = (a, b, unit) => (a === b ? `${a} ${unit}` : `${a} to ${b} ${unit}`);
  if (high < 90) return both(Math.floor(low), Math.ceil(high), "s");
  if (high < 5400) return both(Math.max(1, Math.floor(low / 60)), Math.ceil(high / 60), "min");
  return both(Math.max(0.5, Math.floor(low / 1800) / 2), Math.ceil(high / 1800) / 2, "h");
}
