"use strict";
// Shows the OpenAPI document, grouped by tag. Text only ever enters the page as text.

const routes = document.getElementById("routes");

function make(tag, properties = {}, ...children) {
  const element = Object.assign(document.createElement(tag), properties);
  element.append(...children);
  return element;
}

function resolve(schema, document_) {
  if (!schema || !schema.$ref) return schema || {};
  return schema.$ref.slice(2).split("/").reduce((part, key) => part[key], document_);
}

function typeOf(schema, document_) {
  const known = resolve(schema, document_);
  if (schema.$ref) return known.title || "object";
  if (known.enum) return known.enum.map((value) => JSON.stringify(value)).join(" | ");
  if ("const" in known) return JSON.stringify(known.const);
  const options = known.anyOf || known.oneOf;
  if (options) return options.map((option) => typeOf(option, document_)).join(" | ");
  if (known.prefixItems) return `[${known.prefixItems.map((item) => typeOf(item, document_)).join(", ")}]`;
  if (known.type === "array") return `${typeOf(known.items || {}, document_)}[]`;
  return known.type || "any";
}

function fields(schema, document_) {
  const known = resolve(schema, document_);
  const table = make("table", {}, make("tr", {}, ...["field", "type", "default"].map((t) => make("th", { textContent: t }))));
  for (const [name, field] of Object.entries(known.properties || {})) {
    const needed = (known.required || []).includes(name);
    const initial = "default" in field ? JSON.stringify(field.default) : needed ? "required" : "";
    table.append(make("tr", {},
      make("td", {}, make("code", { textContent: name })),
      make("td", {}, make("code", { textContent: typeOf(field, document_) })),
      make("td", {}, make("code", { textContent: initial }))));
  }
  return Object.keys(known.properties || {}).length ? table : make("p", { textContent: "No fields: send {} or nothing." });
}

function bodyOf(operation, document_) {
  if (!operation.requestBody) return [];
  const [kind, media] = Object.entries(operation.requestBody.content)[0];
  if (kind !== "application/json") return [make("h3", { textContent: `Body: ${kind}` })];
  let schema = media.schema;
  if (schema.anyOf) schema = schema.anyOf.find((option) => option.$ref) || schema;
  return [make("h3", { textContent: "Body" }), fields(schema, document_)];
}

function parametersOf(operation, document_) {
  if (!(operation.parameters || []).length) return [];
  const table = make("table");
  for (const parameter of operation.parameters) {
    table.append(make("tr", {},
      make("td", {}, make("code", { textContent: parameter.name })),
      make("td", { textContent: parameter.in }),
      make("td", {}, make("code", { textContent: typeOf(parameter.schema || {}, document_) })),
      make("td", { textContent: parameter.description || "" })));
  }
  return [make("h3", { textContent: "Parameters" }), table];
}

function answersOf(operation, document_) {
  const table = make("table");
  for (const [status, answer] of Object.entries(operation.responses || {})) {
    const [kind, media] = Object.entries(answer.content || {})[0] || ["", {}];
    const type = media.schema && Object.keys(media.schema).length ? typeOf(media.schema, document_) : kind;
    table.append(make("tr", {},
      make("td", {}, make("code", { textContent: status })),
      make("td", { textContent: answer.description || "" }),
      make("td", {}, make("code", { textContent: type }))));
  }
  return [make("h3", { textContent: "Answers" }), table];
}

function entry(verb, path, operation, document_) {
  const inside = make("div", { className: "inside" });
  const item = make("details", {},
    make("summary", {},
      make("span", { className: `verb ${verb}`, textContent: verb.toUpperCase() }),
      make("code", { textContent: path.replace("/api/v1", ""), title: path }),
      make("span", { textContent: operation.summary || "" })),
    inside);
  item.dataset.text = `${verb} ${path} ${operation.summary || ""} ${operation.description || ""}`.toLowerCase();
  item.addEventListener("toggle", () => {
    if (inside.childElementCount) return;
    inside.append(make("p", { textContent: operation.description || "" }),
      ...parametersOf(operation, document_), ...bodyOf(operation, document_), ...answersOf(operation, document_));
  }, { once: true });
  return item;
}

function filter() {
  const wanted = document.getElementById("filter").value.trim().toLowerCase();
  for (const group of routes.querySelectorAll("section")) {
    let any = false;
    for (const item of group.querySelectorAll("details")) {
      item.hidden = !item.dataset.text.includes(wanted);
      any = any || !item.hidden;
    }
    group.hidden = !any;
  }
}

async function load() {
  const answer = await fetch("openapi.json");
  if (!answer.ok) throw new Error(`the server answered ${answer.status}`);
  const document_ = await answer.json();
  document.getElementById("version").textContent = document_.info.version;
  document.getElementById("about").textContent =
    `${document_.info.description || ""} Addresses begin with ${new URL(".", location.href).href.slice(0, -1)}; send "Authorization: Bearer TOKEN".`;
  const groups = new Map((document_.tags || []).map((tag) => [tag.name, { about: tag.description, items: [] }]));
  for (const [path, verbs] of Object.entries(document_.paths)) {
    for (const [verb, operation] of Object.entries(verbs)) {
      const tag = (operation.tags || ["other"])[0];
      if (!groups.has(tag)) groups.set(tag, { about: "", items: [] });
      groups.get(tag).items.push(entry(verb, path, operation, document_));
    }
  }
  routes.replaceChildren(...[...groups].filter(([, group]) => group.items.length).map(([name, group]) =>
    make("section", {}, make("h2", { textContent: name }), make("p", { className: "about", textContent: group.about }), ...group.items)));
  document.getElementById("filter").addEventListener("input", filter);
}

load().catch((error) => { routes.textContent = `The API description could not be read: ${error.message}`; });
