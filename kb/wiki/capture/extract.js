// The whole page in one call: elements in reading order, cells on their grid, boxes in CSS pixels
// of the page. Called as the body of a function with one argument, the profile's selectors.
// Returns {page, elements, cells, facts, recipes}; kb/wiki/parse/tables.py and kb/wiki/parse/facts.py read it.
const rules = arguments[0];
const doc = document.documentElement;
const root = document.querySelector(rules.root) || document.body;
const TEXT = new Set(["P", "H1", "H2", "H3", "H4", "H5", "H6", "UL", "OL", "DL", "LI", "DT", "DD", "BLOCKQUOTE",
  "PRE", "FIGCAPTION", "CAPTION", "SUMMARY", "ADDRESS"]);
const SKIP = new Set(["SCRIPT", "STYLE", "TEMPLATE", "NOSCRIPT", "IFRAME", "OBJECT", "LINK", "META", "svg"]);
const INLINE = new Set(["A", "ABBR", "B", "BDI", "BR", "CITE", "CODE", "EM", "I", "KBD", "MARK", "Q", "S", "SMALL",
  "SPAN", "STRONG", "SUB", "SUP", "TIME", "U", "VAR", "WBR", "IMG"]);
const elements = [], cells = [], facts = [], recipes = [];
const styles = new Map(), clips = new Map(), placed = new Map(), strokes = new Map();
let truncated = false, entries = 0, without = null, marked = true;

// What JSON and Arrow can't hold becomes U+FFFD.
const sound = (s) => (typeof s === "string" ? s.toWellFormed().replaceAll("\0", "\uFFFD") : s);
const style = (e) => styles.get(e) || (styles.set(e, getComputedStyle(e)), styles.get(e));
const isChrome = (e) => SKIP.has(e.tagName) || e.matches(rules.chrome);
const shown = (e) => e.checkVisibility({ opacityProperty: true, visibilityProperty: true });
const pageWidth = Math.max(doc.scrollWidth, doc.clientWidth), pageHeight = Math.max(doc.scrollHeight, doc.clientHeight);
const everything = [0, 0, pageWidth, pageHeight];

function meet(a, b) {
  return [Math.max(a[0], b[0]), Math.max(a[1], b[1]), Math.min(a[2], b[2]), Math.min(a[3], b[3])];
}
function edges(r) {
  return [r.left + scrollX, r.top + scrollY, r.right + scrollX, r.bottom + scrollY];
}
// What the ancestors let through: a box outside of a scrolled or folded container is on no screenshot.
function clip(e) {
  if (!e || e === doc || e === document.body) return everything;
  let area = clips.get(e);
  if (!area) {
    area = clip(e.parentElement);
    const s = style(e);
    if (s.display !== "inline" && s.display !== "contents" && (s.overflowX !== "visible" || s.overflowY !== "visible")) {
      area = meet(area, edges(e.getBoundingClientRect()));
    }
    clips.set(e, area);
  }
  return area;
}
function place(rect, holder, seen) {
  const b = meet(edges(rect), clip(holder)), w = b[2] - b[0], h = b[3] - b[1];
  const visible = seen && w > 0 && h > 0;
  const raw = visible ? [b[0], b[1], w, h] : [rect.left + scrollX, rect.top + scrollY, rect.width, rect.height];
  return { visible, box: raw.map((n) => Math.round(n * 100) / 100) };
}

// The boxes of a text node on the page, one a line that it stands on, with what its holder lets through.
function strokesOf(node) {
  let found = strokes.get(node);
  if (!found) {
    const range = document.createRange(), area = clip(node.parentElement);
    range.selectNodeContents(node);
    found = [...range.getClientRects()].map((r) => meet(edges(r), area)).filter((b) => b[2] > b[0] && b[3] > b[1]);
    strokes.set(node, found);
  }
  return found;
}
// Pieces that stand beside each other are one line: letters of one size or another, raised or lowered.
// A column's end is one too: the same node goes on at another place of the same height.
function linesOf(blocks) {
  const lines = [];
  for (const nodes of blocks) {
    let line = null;
    for (const node of nodes) {
      strokesOf(node).forEach((b, number) => {
        const high = line && Math.min(line[3], b[3]) - Math.max(line[1], b[1]);
        const beside = line && high >= Math.min(line[3] - line[1], b[3] - b[1]) / 2;
        const far = number && beside && (b[0] > line[2] + 1 || b[2] < line[0] - 1);
        if (!beside || far) lines.push(line = [...b]);
        else [line[0], line[1], line[2], line[3]] = [Math.min(line[0], b[0]), Math.min(line[1], b[1]), Math.max(line[2], b[2]), Math.max(line[3], b[3])];
      });
    }
  }
  return lines.map((b) => [b[0], b[1], b[2] - b[0], b[3] - b[1]].map((n) => Math.round(n * 100) / 100)).filter((b) => b[2] > 0 && b[3] > 0);
}

// Text as shown: chrome and tables left out, hidden parts left out of what is visible itself.
// `blocks` gets the text nodes, those of each block and behind each break apart.
function textOf(nodes, seen, pre, blocks) {
  let out = "";
  const line = () => { if (out && !out.endsWith("\n")) out += "\n"; };
  const take = (node, raw) => {
    if (node.nodeType === 3) {
      out += raw ? node.data : node.data.replace(/[\s​]+/g, " ");
      if (blocks && /\S/.test(node.data)) blocks[blocks.length - 1].push(node);
      return;
    }
    if (node.nodeType !== 1 || isChrome(node) || node.tagName === "TABLE" || node === without) return;
    if (!marked && node.matches(rules.reference)) return;
    if (node.tagName === "BR") {
      out += "\n";
      if (blocks) blocks.push([]);
      return;
    }
    const s = style(node);
    if (seen && (s.display === "none" || s.visibility === "hidden" || !shown(node) && s.display !== "contents")) return;
    // The slash of a fraction that stands upright is drawn as a line, if it is there at all.
    if (node.matches(rules.denominator) && /[^/⁄\s]\s*$/.test(out)) out = `${out.trimEnd()}/`;
    const block = !s.display.startsWith("inline") && !INLINE.has(node.tagName);
    const apart = blocks && !/^(inline|contents)/.test(s.display);
    if (block) line();
    if (apart) blocks.push([]);
    for (const child of node.childNodes) take(child, raw || s.whiteSpace.startsWith("pre"));
    if (block) line();
    if (apart) blocks.push([]);
  };
  for (const node of nodes) take(node, pre);
  out = sound(out);
  if (pre) return out.replace(/^\n+|\s+$/g, "");
  return out.split("\n").map((part) => part.replace(/\s+/g, " ").trim()).filter(Boolean).join("\n");
}

function regionOf(e, inherited) {
  for (const [name, selector] of rules.regions) if (e.matches(selector)) return name;
  return inherited;
}
function captionOf(img) {
  const figure = img.closest("figure, .thumb, .gallerybox, .thumbinner");
  const inFigure = figure && (figure.querySelector("figcaption, .thumbcaption, .gallerytext")
    || (figure.closest(".gallerybox") || figure).querySelector(".gallerytext"));
  let found = inFigure;
  if (!found) {
    const infobox = img.closest(rules.infobox);
    if (infobox) {
      for (let e = img.parentElement; e && e !== infobox.parentElement && !found; e = e.parentElement) {
        found = e.querySelector("[class*=caption]");
        if (found && found.contains(img)) found = null;
        if (e.querySelectorAll("img").length > 1 || e.tagName === "TR") break;
      }
    }
  }
  return found ? textOf([found], false, false) || null : null;
}
function fileOf(img) {
  const link = img.closest("a[href]");
  return link && (link.matches(".mw-file-description, .image") || link.closest("[typeof^='mw:File'], .thumb, .gallerybox"))
    ? link.href : null;
}
function picture(img) {
  return { src: img.currentSrc || img.src || null, alt: sound(img.getAttribute("alt")), file: fileOf(img),
    natural: [img.naturalWidth, img.naturalHeight], loaded: img.complete && img.naturalWidth > 0 };
}
function nameOf(e) {
  const own = (x) => x && (x.getAttribute("alt") || x.getAttribute("title") || x.getAttribute("aria-label")
    || x.getAttribute("data-minetip-title"));
  return sound(own(e) || own(e.querySelector("[title], [alt], [aria-label]")) || own(e.closest("a[title], [title], [data-minetip-title]")) || null);
}
function backgroundOf(e) {
  const found = /url\(["']?(.*?)["']?\)/.exec(style(e).backgroundImage || "");
  return found && !found[1].startsWith("data:") ? new URL(found[1], document.baseURI).href : null;
}
function add(kind, e, ctx, more) {
  if (elements.length >= rules.max_elements) { truncated = true; return ctx.parent; }
  const { rect, blocks, ...rest } = more;
  const where = place(rect || e.getBoundingClientRect(), rect ? e : e.parentElement, ctx.seen ?? shown(e));
  const id = elements.length, lines = blocks ? { lines: where.visible ? linesOf(blocks) : null } : {};
  elements.push({ id, parent: ctx.parent, kind, tag: e.tagName.toLowerCase(), region: ctx.region, level: null,
    text: null, ...where, ...lines, ...rest });
  if (!placed.has(e)) placed.set(e, id);
  return id;
}

// HTML's table model: columns are what is free, spans end with their row group and with the table.
function grid(table) {
  const rows = [...table.rows], taken = rows.map(() => []), found = new Map();
  const groupEnd = rows.map((row, i) => { let j = i; while (j + 1 < rows.length && rows[j + 1].parentNode === row.parentNode) j++; return j; });
  const ends = [];
  rows.forEach((row, r) => {
    let c = 0, end = 0;
    for (const cell of row.cells) {
      while (taken[r][c]) c++;
      const left = groupEnd[r] - r + 1;
      const rowSpan = cell.rowSpan === 0 ? left : Math.min(cell.rowSpan, left);
      const colSpan = Math.max(1, cell.colSpan);
      for (let i = 0; i < rowSpan; i++) for (let j = 0; j < colSpan; j++) taken[r + i][c + j] = true;
      found.set(cell, { row: r, column: c, rowspan: rowSpan, colspan: colSpan });
      c += colSpan;
      end = c;
    }
    if (row.cells.length) ends.push(end);
  });
  // A span may name more columns than any row has: the table ends with its last begun column.
  let columns = ends.length ? Math.min(...ends) : 0;
  for (const at of found.values()) columns = Math.max(columns, at.column + 1);
  for (const at of found.values()) at.colspan = Math.min(at.colspan, columns - at.column);
  return found;
}

function framesOf(e) {
  return [...e.children].filter((child) => !isChrome(child)).map((child) => {
    const img = child.matches("img") ? child : child.querySelector("img");
    const held = child.getAttribute("data-duration") || child.getAttribute("data-delay") || child.getAttribute("data-interval");
    const sprite = img ? null : [child, ...child.querySelectorAll("*")].find((x) => backgroundOf(x));
    return { ...(img ? picture(img) : { src: sprite ? backgroundOf(sprite) : null, alt: nameOf(child), file: null, loaded: true }),
      text: textOf([child], false, false) || null, duration: held && /^\d+(\.\d+)?$/.test(held.trim()) ? Number(held) : null };
  });
}

// Rows of an infobox: a field and its value, several beside each other, or values below their fields.
// Marks of footnotes are left out.
function readFacts(box) {
  marked = false;
  readRows(box);
  marked = true;
}
function readRows(box) {
  const title = box.querySelector(rules.fact_subject), subject = title && textOf(title.childNodes, shown(title), false) || null;
  let above = [];
  for (const row of box.querySelectorAll(rules.fact)) {
    if (isChrome(row)) continue;
    let fields = [...row.querySelectorAll(rules.fact_field)];
    const values = [...row.querySelectorAll(rules.fact_value)];
    if (!fields.length && !above.length && values.length === 2) fields = [values.shift()];
    const heads = fields.length ? fields : above;
    above = !values.length && fields.length > 1 ? fields : [];
    if (values.length !== heads.length) continue;
    values.forEach((value, number) => {
      const head = heads[number], seen = shown(value), { visible } = place(value.getBoundingClientRect(), value.parentElement, seen);
      const pictures = [...value.querySelectorAll("img")].filter((img) => !seen || shown(img)).map(nameOf).filter(Boolean);
      if (!room()) return;
      facts.push({ subject, field: textOf(head.childNodes, shown(head), false),
        value: textOf(value.childNodes, seen, false) || pictures.join("\n"), visible, at: value });
    });
  }
}
// Grids of slots: what lies in each, one after the other where it is shown in turn.
function readRecipe(grid) {
  const slots = [], last = { true: { row: -1, column: 0 }, false: { row: -1, column: 0 } };
  for (const slot of grid.querySelectorAll(rules.slot)) {
    if (isChrome(slot) || slot.parentElement.closest(rules.slot)) continue;
    if (!room()) break;
    const output = Boolean(slot.closest(rules.slot_output)), group = slot.closest(rules.slot_row), at = last[output];
    if (at.row < 0 || at.group !== group) Object.assign(at, { group, row: at.row + 1, column: 0 }); else at.column++;
    const turning = slot.matches(rules.animation) ? slot : slot.querySelector(rules.animation);
    const turns = turning ? [...turning.children].filter((child) => !isChrome(child) && !child.matches(rules.quantity)) : [];
    const frames = turns.flatMap((turn) => (turn.matches(rules.animation_group) ? [...turn.children] : [turn]));
    const items = (frames.length > 1 ? frames : [slot]).map((frame) => itemOf(frame, slot));
    const { visible } = place(slot.getBoundingClientRect(), slot.parentElement, shown(slot));
    slots.push({ output, row: at.row, column: at.column, visible, items, at: slot });
    entries += items.length;
  }
  if (slots.length) recipes.push({ slots });
}
function itemOf(e, slot) {
  const every = [e, ...e.querySelectorAll("*")];
  const named = (name) => sound(every.map((x) => x.getAttribute(name)).find((given) => given?.trim()) ?? null);
  const amount = every.find((x) => x.matches(rules.quantity)) || [...slot.children].find((x) => x.matches(rules.quantity));
  without = amount;
  const text = textOf(e.childNodes, false, false) || null;
  without = null;
  return { filled: every.some((x) => x.tagName === "IMG" || x !== slot && backgroundOf(x)), tip: named("data-minetip-title"),
    alt: named("alt"), title: named("title"), label: named("aria-label"), absent: every.some((x) => x.matches("a.new")), text,
    quantity: amount && textOf(amount.childNodes, false, false) || null };
}
// As many as there may be elements.
function room() {
  if (facts.length + entries < rules.max_elements) return true;
  truncated = true;
  return false;
}
// The element that stands for what is in a slot: a picture of it before its text.
const within = (e) => [e, ...e.querySelectorAll("*")].filter((x) => placed.has(x)).map((x) => placed.get(x));
function elementOfSlot(slot) {
  const found = within(slot);
  return found.find((id) => elements[id].kind !== "text") ?? found[0] ?? null;
}
// The element that holds a value: its own, else the first inside of it, else the nearest around it.
function elementOfValue(value) {
  const [found] = within(value);
  if (found !== undefined) return found;
  for (let e = value.parentElement; e && e !== root; e = e.parentElement) if (placed.has(e)) return placed.get(e);
  return null;
}

function walk(e, ctx, grids) {
  if (isChrome(e)) return;
  const tag = e.tagName, region = regionOf(e, ctx.region), here = { ...ctx, region };
  if (!here.fact && e.matches(rules.infobox)) { here.fact = true; readFacts(e); }
  if (!here.recipe && e.matches(rules.recipe)) { here.recipe = true; readRecipe(e); }
  if (e.matches(rules.animation) && e.children.length > 1) {
    const frames = framesOf(e), steps = window.__kb ? window.__kb.delay(e) : null;
    if (frames.some((frame) => frame.src)) {
      frames.forEach((frame) => { frame.duration = frame.duration ?? steps; });
      add("animation", e, here, { frames, alt: null, caption: null });
      return;
    }
  }
  if (tag === "IMG") {
    const cycle = window.__kb ? window.__kb.cycle(e) : null;
    const sprite = e.closest(rules.sprite_image);
    const what = { ...picture(e), caption: captionOf(e) };
    if (cycle) add("animation", e, here, { ...what, frames: cycle.map((f) => ({ ...what, ...f, text: null })) });
    else add(sprite ? "sprite" : "image", e, here, sprite ? { ...what, text: nameOf(e) } : what);
    return;
  }
  if (e.matches(rules.sprite) && !e.querySelector("img")) {
    const sheet = backgroundOf(e);
    if (sheet) {
      add("sprite", e, here, { src: sheet, css: true, alt: null, file: null, loaded: true, caption: null,
        position: style(e).backgroundPosition, text: nameOf(e) });
      return;
    }
  }
  let inside = here, runs = !ctx.covered;
  if (tag === "TABLE") {
    if (e.rows.length) {
      const id = add("table", e, here, {});
      inside = { ...here, parent: id, covered: true };
      grids = [grid(e), id];
      runs = false;
    }
  } else if ((tag === "TD" || tag === "TH") && grids && grids[0].has(e)) {
    const text = textOf(e.childNodes, shown(e), false), id = add("cell", e, { ...here, parent: grids[1] }, { text, header: tag === "TH" });
    const { box, visible } = elements[elements.length - 1];
    cells.push({ element: id, table: grids[1], ...grids[0].get(e), header: tag === "TH", text, box, visible });
    inside = { ...here, parent: id, covered: true };
    runs = false;
  } else if (TEXT.has(tag)) {
    const blocks = [[]], text = textOf(e.childNodes, shown(e), tag === "PRE", blocks);
    if (text.trim()) {
      const level = /^H[1-6]$/.test(tag) ? Number(tag[1]) : null;
      inside = { ...here, parent: add("text", e, here, { text, level, blocks }), covered: true };
      runs = false;
    }
  }
  if (!runs) {
    for (const child of e.children) walk(child, inside, grids);
    return;
  }
  // Text that stands bare in a container: every run of inline nodes is one text element.
  let run = [];
  for (const node of e.childNodes) {
    if (isInline(node)) run.push(node);
    else if (node.nodeType === 1) { emitRun(e, run, inside, grids); run = []; walk(node, inside, grids); }
  }
  emitRun(e, run, inside, grids);
}

function isInline(n) {
  if (n.nodeType === 3) return true;
  if (n.nodeType !== 1 || TEXT.has(n.tagName) || n.tagName === "TABLE" || isChrome(n)) return false;
  const shape = style(n).display;
  return (shape === "inline" || shape === "none" && INLINE.has(n.tagName))
    && !n.querySelector("p, table, ul, ol, dl, div, figure, h1, h2, h3, h4, h5, h6, pre, blockquote");
}
function emitRun(e, nodes, ctx, grids) {
  let inside = ctx;
  if (nodes.some((n) => n.textContent.trim())) {
    const seen = shown(e) && nodes.some((n) => n.nodeType === 3 ? n.data.trim() : shown(n));
    const blocks = [[]], text = textOf(nodes, seen, style(e).whiteSpace.startsWith("pre"), blocks);
    if (text.trim()) {
      const range = document.createRange();
      range.setStartBefore(nodes[0]);
      range.setEndAfter(nodes[nodes.length - 1]);
      inside = { ...ctx, covered: true, parent: add("text", e, { ...ctx, seen }, { text, blocks, rect: range.getBoundingClientRect() }) };
    }
  }
  for (const n of nodes) if (n.nodeType === 1) walk(n, inside, grids);
}

walk(root, { parent: null, region: "content", covered: false }, null);
for (const fact of facts) { fact.element = elementOfValue(fact.at); delete fact.at; }
for (const slot of recipes.flatMap((recipe) => recipe.slots)) { slot.element = elementOfSlot(slot.at); delete slot.at; }
return {
  page: { width: pageWidth, height: pageHeight, viewport_width: innerWidth, device_pixel_ratio: devicePixelRatio,
    url: location.href, title: sound(document.title), ...window.__kb.identity(), truncated },
  elements, cells, facts, recipes,
};
