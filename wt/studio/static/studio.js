// Uploads, what is said to those who hear the page, and the focus when a part of it is replaced.
"use strict";
const byId = id => document.getElementById(id);

// files of a drop with the folders that they are in
async function dropped(items) {
  const found = [];
  async function walk(entry, path) {
    if (entry.isFile) {
      const file = await new Promise((done, fail) => entry.file(done, fail));
      found.push([path + file.name, file]);
    } else {
      const reader = entry.createReader();
      for (;;) { // a reader gives a hundred at a time
        const some = await new Promise((done, fail) => reader.readEntries(done, fail));
        if (!some.length) break;
        for (const each of some) await walk(each, `${path}${entry.name}/`);
      }
    }
  }
  for (const entry of [...items].map(i => i.webkitGetAsEntry()).filter(Boolean)) await walk(entry, "");
  return found;
}

async function upload(files) {
  const refused = byId("refused"), bar = byId("uploading");
  refused.replaceChildren();
  bar.hidden = false;
  let sent = 0;
  const total = files.reduce((sum, [, file]) => sum + file.size, 0) || 1;
  for (const [name, file] of files) {
    say(`uploading ${name}`);
    let line = "";
    try {
      const path = name.split("/").map(encodeURIComponent).join("/");
      const answer = await fetch(`files/${path}`, {method: "PUT", body: file});
      if (!answer.ok) line = await answer.text();
    } catch {
      line = `'${name}' could not be sent: is wt studio still running?`;
    }
    if (line) refused.append(Object.assign(document.createElement("li"), {textContent: line}));
    bar.value = (sent += file.size) / total;
  }
  bar.hidden = true;
  if (refused.childElementCount < files.length) htmx.ajax("POST", "check", {target: "#check", swap: "outerHTML"});
}

function say(text) {
  const status = byId("status");
  if (text && status.textContent !== text) status.textContent = text;
}

const drop = byId("drop"), choose = byId("choose");
choose.addEventListener("change", async () => {
  const files = [...choose.files].map(file => [file.name, file]);
  await upload(files);
  choose.value = "";
});
for (const type of ["dragover", "dragleave", "drop"]) addEventListener(type, event => {
  event.preventDefault(); // a file beside the field would replace the page
  drop.classList.toggle("over", type === "dragover");
  if (type === "drop") dropped(event.dataTransfer.items).then(upload);
});

// the curves of the row that is being changed come into view
function show(row) {
  const channel = row?.querySelector("[name^=channel]")?.value, curves = byId("curves");
  for (const figure of curves?.querySelectorAll("figure") ?? []) {
    const now = figure.dataset.channel === channel;
    figure.classList.toggle("now", now);
    if (now) curves.scrollTop += figure.getBoundingClientRect().top - curves.getBoundingClientRect().top - 8;
  }
}
addEventListener("focusin", event => show(event.target.closest(".rows tr")));

// a control that was replaced hands the focus on: to the one of its id, else to its part's heading
let focused = null, part = null;
addEventListener("focusin", event => {
  focused = event.target;
  part = focused.closest("section")?.id;
});
document.body.addEventListener("htmx:afterSettle", event => {
  const told = event.detail.elt.matches("[data-say]") ? event.detail.elt : event.detail.elt.querySelector("[data-say]");
  if (told) say(told.dataset.say);
  if (event.detail.elt.id === "curves") show(document.activeElement.closest(".rows tr"));
  if (focused && !focused.isConnected && document.activeElement === document.body) byId(`${part}-head`)?.focus();
});
for (const type of ["htmx:sendError", "htmx:responseError"])
  document.body.addEventListener(type, event => {
    const line = event.detail.xhr.responseText || "wt studio does not answer: is it still running?";
    byId("refused").replaceChildren(Object.assign(document.createElement("li"), {textContent: line}));
  });
