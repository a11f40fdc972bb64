import { $, get, say } from "./console.js";
import { save, show } from "./shown.js";

const asked = new URLSearchParams(location.search);

document.addEventListener("hello", async () => {
  try {
    const found = await get(`/api/shown?${asked}`);
    $("title").textContent = found.title;
    document.title = `${found.title} - haploop`;
    $("name").textContent = [asked.get("file") || "", found.simulated ? "simulated" : ""].filter(Boolean).join(", ");
    show($("shown"), found, asked);
    $("report").disabled = asked.has("history");
  } catch (error) { $("title").textContent = "This file cannot be shown"; say(error.message, "error"); }
});
$("report").addEventListener("click", () => save(`/api/report?${asked}`, `${asked.get("file").replaceAll("/", "-")}.html`));
