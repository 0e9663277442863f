// The whole page in one call: elements in reading order, cells on their grid, boxes in CSS pixels
// of the page. Called as the body of a function with one argument, the profile's selectors.
// Returns {page, elements, cells, facts, recipes}; kb/wiki/parse/tables.py and kb/wiki/parse/facts.py read it.
const rules = arguments[0];
const doc = document.documentElement;
// The first root in order of preference, and the page's title where it stands outside of that.
const root = rules.root.map((one) => document.querySelector(one)).find(Boolean) || document.body;
const heading = document.querySelector(rules.title);
const roots = heading && !root.contains(heading) && !heading.contains(root) ? [heading, root] : [root];
const TEXT = new Set(["P", "H1", "H2", "H3", "H4", "H5", "H6", "UL", "OL", "DL", "LI", "DT", "DD", "BLOCKQUOTE",
  "PRE", "FIGCAPTION", "CAPTION", "SUMMARY", "ADDRESS"]);
const SKIP = new Set(["SCRIPT", "STYLE", "TEMPLATE", "NOSCRIPT", "IFRAME", "OBJECT", "LINK", "META", "svg"]);
const INLINE = new Set(["A", "ABBR", "B", "BDI", "BR", "CITE", "CODE", "EM", "I", "KBD", "MARK", "Q", "S", "SMALL",
  "SPAN", "STRONG", "SUB", "SUP", "TIME", "U", "VAR", "WBR", "IMG"]);
const elements = [], cells = [], facts = [], recipes = [];
const styles = new Map(), clips = new Map(), placed = new Map(), strokes = new Map();
const states = new Map(), offers = new Map(), bars = new Map();
let truncated = false, entries = 0, unread = 0, without = null, named = new Map();

// What JSON and Arrow can't hold becomes U+FFFD. Characters without width are dropped; joiners stay between letters
// that join, or in a picture of several.
const NO_WIDTH = /[\u00ad\u034f\u061c\u180e\u200b\u200e\u200f\u202a-\u202e\u2060-\u2064\u2066-\u206f\ufeff]/g;
const JOINER = /(?<!(?![a-zA-Z])[\p{L}\p{M}]|[\p{Extended_Pictographic}\p{Emoji_Modifier}\ufe0f])[\u200c\u200d]|[\u200c\u200d](?!(?![a-zA-Z])[\p{L}\p{M}]|\p{Extended_Pictographic})/gu;
const sound = (s) => (typeof s === "string" ? s.toWellFormed().replaceAll("\0", "\uFFFD").replace(NO_WIDTH, "").replace(JOINER, "") : s);
const style = (e) => styles.get(e) || (styles.set(e, getComputedStyle(e)), styles.get(e));
const isChrome = (e) => SKIP.has(e.tagName) || e.matches(rules.chrome) || isBar(e);
const shown = (e) => e.checkVisibility({ opacityProperty: true, visibilityProperty: true });
// Links to see, discuss and edit a template ("v t e"), whatever their words.
function isBar(e) {
  if (!e.childElementCount || e.childElementCount > 7 || e.tagName === "A") return false;
  if (!bars.has(e)) {
    const words = e.textContent.trim();
    const links = words.length < 40 ? [...e.querySelectorAll("a")] : [];
    bars.set(e, links.length > 1 && links.length < 6 && links.some((a) => /action=edit|Special:EditPage/.test(a.getAttribute("href") || ""))
      && (words.match(/\p{L}+/gu) || []).every((word) => word.length === 1 || /^(view|talk|discuss|edit|hist|history)$/i.test(word)));
  }
  return bars.get(e);
}
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
    if (s.clip !== "auto" && /absolute|fixed/.test(s.position) && /rect\((0px,? ?){4}\)|rect\(1px,? 1px,? 1px,? 1px\)/.test(s.clip)
      || /^inset\(\s*(50|100)%/.test(s.clipPath)) area = [0, 0, 0, 0];
    else if (s.display !== "inline" && s.display !== "contents" && (s.overflowX !== "visible" || s.overflowY !== "visible")) {
      area = meet(area, edges(e.getBoundingClientRect()));
    }
    clips.set(e, area);
  }
  return area;
}
// Why an element is not shown: "hidden", "folded" where the page itself offers to show it, else "".
function offered(e) {
  if (!offers.has(e)) {
    const box = e.parentElement?.closest(".mw-collapsed, .collapsed, .mw-collapsible");
    const part = /^(TR|TBODY|THEAD|TFOOT|LI|DT|DD)$/.test(e.tagName) && box?.matches("table, ul, ol, dl");
    offers.set(e, e.matches(rules.folded) || box && (part || e.parentElement === box) || e.hidden === "until-found"
      || controlled.has(e.id) || /^mw-customcollapsible-/.test(e.id)
      || (e.getAttribute("aria-labelledby") || "").split(/\s+/).some((id) => id && document.getElementById(id)?.matches("[role=tab]"))
      || FOLDS.test(e.getAttribute("class") || ""));
  }
  return offers.get(e);
}
// Captions that are laid out and shown when the pointer is over their picture.
const HOVERED = ["figure", ".thumb", ".gallerybox", ".wikia-gallery-item"].map((one) =>
  `${one} :is(figcaption, .thumbcaption, .gallerytext, .gallerytextwrapper, [class*=caption])`).join(", ");
const FOLDS = /(^|[-_\s])tab(s|ber)?[-_]*(panel|pane|content|body|page)|(^|[-_\s])(spoiler|accordion|collapsible|expandable|foldable)/i;
const controlled = new Set([...document.querySelectorAll("[aria-controls]")].flatMap((e) => e.getAttribute("aria-controls").split(/\s+/))
  .concat([...document.querySelectorAll("[role=tab][href^='#'], [data-target^='#'], [data-bs-target^='#'], [data-toggle][href^='#']")]
    .map((e) => (e.getAttribute("data-target") || e.getAttribute("data-bs-target") || e.getAttribute("href")).slice(1))));
function stateOf(e) {
  if (shown(e) || style(e).display === "contents" && (!e.parentElement || shown(e.parentElement))) return "";
  if (!states.has(e)) states.set(e, whyHidden(e));
  return states.get(e);
}
function whyHidden(e) {
  let folded = "";
  for (let a = e; a && a !== doc; a = a.parentElement) {
    const s = style(a), above = a.parentElement;
    if (above?.tagName === "DETAILS" && !above.open && a.tagName !== "SUMMARY") { folded = "folded"; continue; }
    const hides = s.display === "none" || s.contentVisibility === "hidden" || Number(s.opacity) === 0
      || s.visibility !== "visible" && !(above && style(above).visibility !== "visible");
    if (!hides) continue;
    if (!offered(a) && (s.display === "none" || !a.matches(HOVERED))) return "hidden";
    folded = "folded";
  }
  return folded || "hidden";
}
// What is laid out and yet not on the page: scrolled out of a box or a row of tabs, or put where nobody sees it.
function whyCut(rects, holder) {
  let boxes = rects.map(edges).filter((b) => b[2] - b[0] > 1 && b[3] - b[1] > 1), folded = false;
  for (let a = holder; a && a !== doc && a !== document.body; a = a.parentElement) {
    if (offered(a) || a.matches(HOVERED)) folded = true;
    const s = style(a), frame = a.getBoundingClientRect(), b = edges(frame);
    if (s.clip !== "auto" && s.position === "absolute" || /^inset\(\s*(50|100)%/.test(s.clipPath)) return folded ? "folded" : "hidden";
    if (s.display === "inline" || s.overflowX === "visible" && s.overflowY === "visible") continue;
    if (boxes.some((one) => meets(one, b))) continue;
    const scrolls = /auto|scroll/.test(s.overflowX + s.overflowY) && b[2] - b[0] > 1 && b[3] - b[1] > 1;
    const range = [b[0] - a.scrollLeft, b[1] - a.scrollTop, b[0] - a.scrollLeft + a.scrollWidth, b[1] - a.scrollTop + a.scrollHeight];
    if (!folded && !(scrolls && boxes.some((one) => meets(one, range)))) return "hidden";
    folded = true;
    boxes = [b];
  }
  return folded && boxes.length ? "folded" : "hidden";
}
function meets(a, b) {
  return Math.min(a[2], b[2]) - Math.max(a[0], b[0]) > 1 && Math.min(a[3], b[3]) - Math.max(a[1], b[1]) > 1;
}
function stateOfText(node) {
  if (strokesOf(node).some((b) => b[2] - b[0] > 1 && b[3] - b[1] > 1)) return isGhost(node.parentElement) ? "hidden" : "";
  const state = stateOf(node.parentElement);
  if (state) return state;
  const range = document.createRange();
  range.selectNodeContents(node);
  return whyCut([...range.getClientRects()], node.parentElement);
}
// Drawn in no colour, and not by what is behind it.
function isGhost(e) {
  const s = style(e);
  return /^rgba\(.*, 0\)$/.test(s.webkitTextFillColor) && s.textShadow === "none" && s.backgroundClip !== "text"
    && !(parseFloat(s.webkitTextStrokeWidth) > 0);
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
  const lines = [], turn = (b, vertical) => (vertical ? [b[1], b[0], b[3], b[2]] : b);
  for (const nodes of blocks) {
    let line = null;
    for (const node of nodes) {
      const vertical = /^(vertical|sideways)/.test(style(node.parentElement).writingMode);
      strokesOf(node).map((b) => turn(b, vertical)).forEach((b, number) => {
        const high = line && Math.min(line[3], b[3]) - Math.max(line[1], b[1]);
        const beside = line && line.vertical === vertical && high >= Math.min(line[3] - line[1], b[3] - b[1]) / 2;
        const far = number && beside && (b[0] > line[2] + 1 || b[2] < line[0] - 1);
        if (!beside || far) lines.push(line = Object.assign([...b], { vertical }));
        else [line[0], line[1], line[2], line[3]] = [Math.min(line[0], b[0]), Math.min(line[1], b[1]), Math.max(line[2], b[2]), Math.max(line[3], b[3])];
      });
    }
  }
  return lines.map((line) => turn(line, line.vertical)).map((b) => [b[0], b[1], b[2] - b[0], b[3] - b[1]].map((n) => Math.round(n * 100) / 100))
    .filter((b) => b[2] > 0 && b[3] > 0);
}

// Text as shown: chrome, tables and marks of footnotes left out, a formula as its TeX. What is hidden is left out of
// what is shown itself (`all` takes it too); what is folded belongs to it.
// `blocks` gets the text nodes, those of each block and behind each break apart; `pins` where links and icons stand.
function textOf(nodes, all, pre, blocks, pins) {
  let out = "";
  const line = () => { if (out && !out.endsWith("\n")) out += "\n"; };
  const take = (node, raw) => {
    if (node.nodeType === 3) {
      if (!all && /\S/.test(node.data) && stateOfText(node) === "hidden") return;
      const data = node.data.replace(NO_WIDTH, "");
      out += raw ? data : data.replace(/\s+/g, " ");
      if (blocks && /\S/.test(data)) blocks[blocks.length - 1].push(node);
      return;
    }
    if (node.nodeType !== 1 || isChrome(node) || node === without || node.matches(rules.reference)) return;
    if (!all && stateOf(node) === "hidden") return;
    const tex = formulaOf(node);
    if (tex) { out += tex; return; }
    if (named.has(node)) { out += `${/[\s(]$/.test(out) ? "" : " "}${named.get(node)}`; return; }
    if (node.tagName === "TABLE") { line(); return; }
    if (node.tagName === "BR") {
      out += "\n";
      if (blocks) blocks.push([]);
      return;
    }
    const s = style(node);
    // The slash of a fraction that stands upright is drawn as a line, if it is there at all.
    const under = node.matches(rules.denominator) && /[^/⁄\s]\s*$/.test(out);
    if (under) out = `${out.trimEnd()}/`;
    const stacked = under || node.nextElementSibling?.matches(rules.denominator) || node.closest(rules.fraction);
    const block = !/^(inline|contents|ruby|none)|math$/.test(s.display) && !stacked || s.display === "none" && TEXT.has(node.tagName);
    const apart = blocks && !/^(inline|contents)/.test(s.display), before = out;
    if (block) line();
    if (apart) blocks.push([]);
    const from = out.length, absent = node.matches("a.new"), to = pins && node.tagName === "A" ? titleOf(node) : null;
    if (pins && isIcon(node)) pins.push([from, from, nameOf(node.querySelector("img") || node)]);
    for (const child of node.childNodes) take(child, raw || s.whiteSpace.startsWith("pre"));
    if (node.tagName === "SUP" && /[\p{L}\d)\]]$/u.test(out.slice(0, from)) && /^[+\-−]?\d+$/.test(out.slice(from).trim())
      && !/^\s*[⁄/]/.test(node.nextSibling?.textContent ?? "")) out = `${out.slice(0, from)}^${out.slice(from).trim()}`;
    if (to && out.length > from) pins.push(absent ? [from, out.length, to, true] : [from, out.length, to]);
    // What is put elsewhere and has nothing to say parts no words.
    if (out.length === from && /absolute|fixed/.test(s.position)) out = before;
    else if (block) line();
    if (apart) blocks.push([]);
  };
  for (const node of nodes) take(node, pre);
  const whole = sound(out), text = pre ? whole.replace(/^\n+|\s+$/g, "")
    : whole.split("\n").map((part) => part.replace(/\s+/g, " ").trim()).filter(Boolean).join("\n");
  if (pins?.length) pin(pins, out, text);
  return text;
}
// Places in the text as it was read become places in the text as it is told, in characters: white space differs.
function pin(pins, out, text) {
  const told = [...text], filled = [];
  told.forEach((sign, at) => { if (/\S/.test(sign)) filled.push(at); });
  const count = (end) => [...sound(out.slice(0, end)).replace(/\s+/g, "")].length;
  pins.forEach(([from, to, title, ...absent], number) => {
    const begin = count(from), end = to === from ? begin : count(to), behind = end ? filled[end - 1] + 1 : 0;
    const icon = behind + (told[behind] === " " && /\s$/.test(out.slice(0, from)) ? 1 : 0);
    pins[number] = from === to ? [icon, icon, title] : [filled[begin] ?? told.length, behind, title, ...absent];
  });
}
const isIcon = (e) => e.matches(rules.sprite_image) || e.matches(rules.sprite) && !e.querySelector("img");
// The title of the page of this wiki to which a link leads, whether there is one or not; null for addresses elsewhere.
const before = [location.href, document.querySelector("link[rel=canonical]")?.href].filter(Boolean).map((one) => {
  const path = plainPath(new URL(one, document.baseURI)), name = window.RLCONF?.wgPageName;
  return name && path?.endsWith(name) ? path.slice(0, -name.length) : null;
}).find((one) => one !== null) ?? null;
function plainPath(url) {
  try { return decodeURIComponent(url.pathname); } catch { return null; }
}
function titleOf(a) {
  if (!a.hasAttribute("href") || a.matches(".external, .extiw") || !URL.canParse(a.href)) return null;
  const url = new URL(a.href), path = plainPath(url), asks = a.matches(".new") ? [] : ["action", "oldid", "diff"];
  if (url.host !== location.host || !path || asks.some((name) => url.searchParams.has(name))) return null;
  if (url.pathname === location.pathname && url.search === location.search) return null;
  const title = url.searchParams.get("title")
    ?? (before === null ? a.getAttribute("title") : path.startsWith(before) ? path.slice(before.length) : null);
  return title ? sound(title.replace(/_/g, " ").trim()) : null;
}
// What stands in an element with its state; a text of which nothing is shown is hidden, and taken whole.
function readText(e, nodes, pre, blocks, state = stateOf(e)) {
  const read = (all) => { const pins = [], text = textOf(nodes, all, pre, blocks, pins); return { text, marks: pins.length ? pins : undefined }; };
  const shownOf = read(state === "hidden");
  return shownOf.text.trim() || state === "hidden" ? { ...shownOf, state } : { ...read(true), state: "hidden" };
}
function formulaOf(e) {
  if (!e.matches(rules.formula)) return "";
  const tex = e.querySelector("annotation[encoding*='tex' i]")?.textContent
    ?? [e, ...e.querySelectorAll("math, img")].map((x) => x.getAttribute("alttext") || x.getAttribute("alt")).find(Boolean);
  return tex ? tex.trim().replace(/^\{\\(?:display|text)style\s+([\s\S]*)\}$/, "$1").trim() : "";
}

function regionOf(e, inherited) {
  for (const [name, selector] of rules.regions) if (e.matches(selector)) return name;
  return inherited;
}
// The nearest caption that belongs to a picture alone: in a frame of several as many captions as pictures, in order.
const CAPTION = "figcaption, .thumbcaption, .gallerytext, .lightbox-caption", FRAME = "figure, .thumb, .thumbinner, .tsingle, .gallerybox, .wikia-gallery-item";
function captionOf(img) {
  const box = img.closest(FRAME) ? null : img.closest(rules.infobox);
  const named = box ? `${CAPTION}, [class*=caption]` : CAPTION;
  if (img.closest(named) && !img.closest(named).querySelector(FRAME)) return null; // an icon within a caption
  for (let e = img.parentElement; e && e !== root; e = e.parentElement) {
    const captions = [...e.querySelectorAll(named)].filter((x) => !x.contains(img) && !x.parentElement.closest(named));
    const others = [...e.querySelectorAll("img, video, audio")].filter((x) => !captions.some((caption) => caption.contains(x)));
    const own = captions.length === others.length ? captions[others.indexOf(img)] : null;
    if (own) return stateOf(own) === "hidden" && stateOf(img) !== "hidden" ? null : textOf([own], true, false) || null;
    if (captions.length || others.length > 1 && !e.closest(FRAME) || e.matches(".gallerybox, TR") || e === box) return null;
    if (!box && !e.parentElement?.closest(FRAME)) return null;
  }
  return null;
}
function fileOf(img) {
  const link = img.closest("a[href]");
  return link && (link.matches(".mw-file-description, .image") || link.closest("[typeof^='mw:File'], .thumb, .gallerybox"))
    ? link.href : null;
}
function picture(img) {
  // What leads to the page itself, as src="" and src="#" do, is no picture.
  const src = img.currentSrc || img.src, page = (address) => address.replace(/\??(#.*)?$/, "");
  return { src: src && page(src) !== page(location.href) ? src : null, alt: sound(img.getAttribute("alt")), file: fileOf(img),
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
  const state = ctx.state ?? stateOf(e), area = rect || e.getBoundingClientRect(), holder = rect ? e : e.parentElement;
  const where = place(area, holder, !state);
  where.folded = state === "folded" || !state && !where.visible && whyCut([area], holder) === "folded";
  if (where.folded) where.box = null;
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
      text: textOf([child], true, false) || null, duration: held && /^\d+(\.\d+)?$/.test(held.trim()) ? Number(held) : null };
  });
}

// The facts of an infobox: its own tables over their grids, lists of terms, pairs of a name and a value, names in bold.
// A name that several groups of a box have is told with its group. Rows that can't be read are counted.
const NAMING = "table, dl, h1, h2, h3, h4, h5, h6";
function readFacts(box) {
  const told = [], around = (e) => { const cell = e.parentElement?.closest("td, th"); return cell && cell !== box && box.contains(cell); };
  const outer = (e) => { const table = e.closest("table"); return !table || !box.contains(table) || !around(table); };
  const title = [...box.querySelectorAll(rules.fact_subject)].find(outer);
  const subject = title && textOf(title.childNodes, !shown(title), false).replace(/[\s:：]+$/, "") || null;
  const words = (e) => textOf(e.childNodes, !shown(e), false);
  // What a fact was made of is passed over when it is met again, with all that is inside of it.
  const passed = new Set();
  let group = null;
  const nameIn = (e) => words(e).replace(/[\s:：]+$/, "");
  // `names` are elements or texts, `nodes` the value, a part of `at`; `unsure` where a title may be taken for a name.
  const tell = (names, at, nodes = at.childNodes, unsure = false) => {
    const field = names.map((name) => (name?.nodeType ? nameIn(name) : name)).filter(Boolean);
    const value = valueOf(at, nodes).replace(/^[\s:：]+/, "");
    if (!field.length || !value || unsure && !textOf(nodes, true, false)) return false;
    if (room()) told.push({ subject, field: field.join(" › "), group, value, unsure, visible: place(at.getBoundingClientRect(), at.parentElement, shown(at)).visible, at });
    return true;
  };
  const isTitle = (e) => [...e.querySelectorAll("b, strong")].map(words).join("") === words(e);
  const missed = (e) => { if (words(e).trim()) unread++; };
  const isBold = (node) => node.nodeType === 1 && /^(B|STRONG)$/.test(node.tagName);
  const behind = (e) => e.nextSibling?.textContent.trim() || e.nextElementSibling?.textContent.trim() || "";
  const isMarked = (e) => /(^|[-_\s])(label|name|key|term|field)([-_\s]|$)/i.test(e.getAttribute("class") || "") || /[:：]\s*$/.test(e.textContent)
    || isBold(e) && /^[:：]/.test(behind(e));
  const isName = (e) => isMarked(e) || isBold(e) || Number(style(e).fontWeight) >= 600;
  // What has names of its own is no value: that of a bold title would be all that the box says.
  const holdsNames = (e) => e.matches(NAMING) || [...e.querySelectorAll("*")].some((x) => x.matches(NAMING) || isMarked(x) && /[^\s:：]/.test(behind(x)));
  // Names in bold at the beginning of a line, each with what follows it.
  const readBold = (e) => {
    let name = null, nodes = [], fresh = true, found = false;
    const end = () => {
      if (name && tell([name], e, nodes, !isMarked(name))) {
        found = true;
        for (const node of [name, ...nodes]) passed.add(node);
      }
      name = null;
      nodes = [];
    };
    for (const node of e.childNodes) {
      const other = node.nodeType === 1 && holdsNames(node);
      if (other) end();
      else if (isBold(node) && fresh) { end(); name = node; } else if (name) nodes.push(node);
      fresh = other || node.nodeName === "BR" || fresh && node.nodeType === 3 && !node.data.trim();
    }
    end();
    return found;
  };
  const readTable = (table) => {
    const places = grid(table), rows = [...table.rows], cover = rows.map(() => []);
    for (const [cell, at] of places) for (let i = 0; i < at.rowspan; i++) for (let j = 0; j < at.colspan; j++) cover[at.row + i][at.column + j] = cell;
    const width = Math.max(0, ...cover.map((row) => row.length));
    const lines = rows.filter((row) => row.matches(rules.fact) && !isChrome(row));
    const fields = new Set(lines.flatMap((row) => [...row.querySelectorAll(rules.fact_field)]));
    const values = new Set(lines.flatMap((row) => [...row.querySelectorAll(rules.fact_value)]));
    let heads = [], pending = null, before = "";
    rows.forEach((row, r) => {
      if (!lines.includes(row)) return;
      const cells = [...new Set(cover[r])].filter((cell) => (fields.has(cell) || values.has(cell)) && !isChrome(cell));
      const names = cells.filter((cell) => fields.has(cell)), others = cells.filter((cell) => !fields.has(cell));
      const begins = (...given) => given.some((cell) => cell.nodeType && places.get(cell).row === r);
      const head = (cell) => heads[places.get(cell).column];
      const headsOf = (cell) => {
        const { column, colspan } = places.get(cell);
        return [...new Set(heads.slice(column, column + colspan))].filter(Boolean);
      };
      if (!cells.length) return;
      if (cells.length === 1 && places.get(cells[0]).colspan >= width) {
        const [cell] = cells;
        if (names.length) {
          heads = [];
          pending = title && (cell === title || cell.contains(title)) ? null : cell;
          group = pending ? nameIn(cell) || null : group;
        } else {
          const inner = cell.querySelectorAll("table");
          if (pending && words(cell).trim()) tell([pending], cell);
          else if (!readBold(cell) && inner.length === 1 && !words(cell).trim()) readTable(inner[0]);
          else if (!pending && r && !cell.querySelector("img") && !isTitle(cell)) missed(cell);
          pending = null;
        }
        before = "";
        return;
      }
      pending = null;
      if (!others.length) { // heads of columns, in one row or more
        if (before !== "heads") heads = [];
        for (const cell of names) for (let j = 0; j < places.get(cell).colspan; j++) {
          const at = places.get(cell).column + j, text = nameIn(cell);
          heads[at] = heads[at] && heads[at] !== text ? `${heads[at]} › ${text}` : text;
        }
        before = "heads";
      } else if (!names.length) {
        const first = others[0], lead = heads.some(Boolean) ? !head(first) && others.length > 1 && first : others.length === 2 && first;
        for (const cell of others) if (cell !== lead && begins(cell)) { if (!lead && !head(cell) || !tell([lead, head(cell)], cell) && !words(lead || cell)) missed(cell); }
        before = "values";
      } else {
        if (before === "values") heads = [];
        let current = [], closed = false;
        for (const cell of cells) {
          if (fields.has(cell)) { current = closed ? [cell] : [...current, cell]; closed = false; }
          else if (!current.length) missed(cell);
          else {
            const above = headsOf(cell); // a value below several heads is that of each
            if (begins(cell, ...current)) for (const one of above.length ? above : [""]) tell([...current, one], cell);
            closed = true;
          }
        }
        before = "names";
      }
    });
  };
  const readRow = (row) => {
    const fields = [...row.querySelectorAll(rules.fact_field)], values = [...row.querySelectorAll(rules.fact_value)];
    if (fields.length === values.length) values.forEach((value, number) => tell([fields[number]], value));
    else if (fields.length === 1) values.forEach((value) => tell(fields, value));
    else if (fields.length) missed(row);
  };
  // A list within a value has names below those of the value.
  const readList = (list, above = []) => {
    let names = [];
    for (const e of [...list.querySelectorAll("dt, dd")].filter((x) => x.closest("dl") === list)) {
      if (e.tagName === "DT") names = names.closed || !names.length ? [e] : [...names, e];
      else {
        const own = [...e.childNodes].filter((node) => node.nodeType !== 1 || !node.matches("dl") && !node.querySelector("dl"));
        const inner = [...e.querySelectorAll("dl")].filter((x) => x.parentElement.closest("dl") === list);
        for (const name of names) {
          tell([...above, name], e, own);
          inner.forEach((x) => readList(x, [...above, name]));
        }
        names.closed = true;
      }
    }
  };
  const plain = (e) => e && e.childElementCount < 20 && !e.matches("img, figure") && !holdsNames(e) && words(e).trim();
  for (const e of [box, ...box.querySelectorAll("*")]) {
    if (passed.has(e) || passed.has(e.parentElement) || isChrome(e)) { passed.add(e); continue; }
    if (e.tagName === "TABLE") { passed.add(e); readTable(e); }
    else if (e !== box && e.matches(rules.fact)) { passed.add(e); readRow(e); }
    else if (e.tagName === "DL") { passed.add(e); readList(e); }
    else if (e !== box && tabName(e)) group = tabName(e);
    else if (e !== title && e.matches(".pi-header, h2, h3, h4")) { passed.add(e); group = nameIn(e) || null; }
    else if (readBold(e)) continue;
    else if (e !== title && e.tagName !== "A" && plain(e) && isName(e) && plain(e.nextElementSibling) && !isName(e.nextElementSibling)
      && !/\S/.test(e.nextSibling?.nodeType === 3 ? e.nextSibling.data : "") && !e.previousElementSibling?.matches("a, b, strong")) {
      for (let value = e.nextElementSibling; plain(value) && !isName(value); value = value.nextElementSibling) {
        tell([e], value, value.childNodes, !isMarked(e));
        passed.add(value);
      }
    }
  }
  const signs = (text) => text.replace(/[\s:：]/g, "").length;
  if (told.length === 1 && told[0].unsure && signs(told[0].field + told[0].value) >= signs(words(box))) told.pop();
  const groups = new Map();
  for (const { field, group: one } of told) groups.set(field, (groups.get(field) || new Set()).add(one));
  for (const { group: one, unsure, ...fact } of told) facts.push(groups.get(fact.field).size > 1 && one ? { ...fact, field: `${one} › ${fact.field}` } : fact);
}
// What the tab is called that shows a part; "" for what is no tab's part.
function tabName(e) {
  if (!e.matches(rules.folded)) return "";
  const named = document.getElementById(e.getAttribute("aria-labelledby") || ""), around = e.closest(".wds-tabber, .tabber");
  const parts = around ? [...e.parentElement.children].filter((one) => one.matches(rules.folded)) : [];
  const tab = named || around?.querySelectorAll(".wds-tabs__tab, [role=tab], .tabber__tab")[parts.indexOf(e)];
  return (tab ? textOf(tab.childNodes, true, false) : e.getAttribute("data-title") || e.getAttribute("title") || "").trim();
}
// A value's words with the names of pictures that stand between them, else the names of its pictures.
function valueOf(at, nodes) {
  const all = !shown(at), text = textOf(nodes, all, false);
  const inside = [...nodes].flatMap((n) => (n.nodeType === 1 ? [...(n.matches("img") ? [n] : []), ...n.querySelectorAll("img")] : []));
  const seen = inside.filter((img) => all || shown(img));
  if (!text) return seen.map(nameOf).filter(Boolean).join("\n");
  named = new Map(seen.map((img) => [img, sound(img.getAttribute("alt"))?.trim()]).filter(([, name]) => name && !/\.\w{3,4}$/.test(name) && !text.includes(name)));
  const full = named.size ? textOf(nodes, all, false) : text;
  named = new Map();
  return full;
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
  if (slots.length) recipes.push({ slots, shape: shapeOf(grid) });
}
// What a recipe's grid calls itself: its classes, and the names of pictures outside of its slots.
function shapeOf(grid) {
  const pictures = [...grid.querySelectorAll("img")].filter((img) => !img.closest(rules.slot) && !isChrome(img));
  return [grid.getAttribute("class"), grid.getAttribute("title"), grid.getAttribute("aria-label"), ...pictures.map(nameOf)].filter(Boolean).map(sound);
}
function itemOf(e, slot) {
  const every = [e, ...e.querySelectorAll("*")];
  const named = (name) => sound(every.map((x) => x.getAttribute(name)).find((given) => given?.trim()) ?? null);
  const amount = every.find((x) => x.matches(rules.quantity)) || [...slot.children].find((x) => x.matches(rules.quantity));
  without = amount;
  const text = textOf(e.childNodes, true, false) || null;
  without = null;
  return { filled: every.some((x) => x.tagName === "IMG" || x !== slot && backgroundOf(x)), tip: named("data-minetip-title"),
    alt: named("alt"), title: named("title"), label: named("aria-label"), absent: every.some((x) => x.matches("a.new")), text,
    quantity: amount && textOf(amount.childNodes, true, false) || null };
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
    if (!what.src && !cycle && !sprite) return;
    if (cycle) add("animation", e, here, { ...what, frames: cycle.map((f) => ({ ...what, ...f, text: null })) });
    else add(sprite ? "sprite" : "image", e, here, sprite ? { ...what, text: nameOf(e) } : what);
    return;
  }
  if (tag === "VIDEO" || tag === "AUDIO") {
    const address = e.currentSrc || e.src || e.querySelector("source[src]")?.src || null;
    const parent = add(tag.toLowerCase(), e, here, { address });
    if (e.poster) {
      add("image", e, { ...here, parent }, { src: e.poster, poster: true, alt: nameOf(e), file: fileOf(e), natural: null, loaded: true, caption: captionOf(e) });
    }
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
    const { text, marks } = readText(e, e.childNodes, false), id = add("cell", e, { ...here, parent: grids[1] }, { text, marks, header: tag === "TH" });
    const { box, visible } = elements[elements.length - 1];
    cells.push({ element: id, table: grids[1], ...grids[0].get(e), header: tag === "TH", text, box, visible });
    inside = { ...here, parent: id, covered: true };
    runs = false;
  } else if (TEXT.has(tag)) {
    const blocks = [[]], { text, marks, state } = readText(e, e.childNodes, tag === "PRE", blocks);
    if (text.trim()) {
      const level = /^H[1-6]$/.test(tag) ? Number(tag[1]) : null;
      inside = { ...here, parent: add("text", e, { ...here, state }, { text, marks, level, blocks }), covered: true };
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
  if (n.matches(rules.formula)) return true;
  const shape = style(n).display;
  return (shape === "inline" || shape === "none" && INLINE.has(n.tagName))
    && !n.querySelector("p, table, ul, ol, dl, div, figure, h1, h2, h3, h4, h5, h6, pre, blockquote");
}
function emitRun(e, nodes, ctx, grids) {
  let inside = ctx;
  if (nodes.some((n) => n.textContent.trim() || n.nodeType === 1 && n.matches(rules.formula))) {
    const told = nodes.filter((n) => n.nodeType === 1 || n.data.trim()).map((n) => (n.nodeType === 3 ? stateOfText(n) : stateOf(n)));
    const held = stateOf(e) || (["", "folded"].find((one) => told.includes(one)) ?? "hidden");
    const blocks = [[]], { text, marks, state } = readText(e, nodes, style(e).whiteSpace.startsWith("pre"), blocks, held);
    if (text.trim()) {
      const range = document.createRange();
      range.setStartBefore(nodes[0]);
      range.setEndAfter(nodes[nodes.length - 1]);
      inside = { ...ctx, covered: true, parent: add("text", e, { ...ctx, state }, { text, marks, blocks, rect: range.getBoundingClientRect() }) };
    }
  }
  for (const n of nodes) if (n.nodeType === 1) walk(n, inside, grids);
}

for (const e of roots) walk(e, { parent: null, region: "content", covered: false }, null);
for (const fact of facts) { fact.element = elementOfValue(fact.at); delete fact.at; }
for (const slot of recipes.flatMap((recipe) => recipe.slots)) { slot.element = elementOfSlot(slot.at); delete slot.at; }
return {
  page: { width: pageWidth, height: pageHeight, viewport_width: innerWidth, device_pixel_ratio: devicePixelRatio,
    url: location.href, title: sound(document.title), ...window.__kb.identity(), truncated, unread_facts: unread },
  elements, cells, facts, recipes,
};
