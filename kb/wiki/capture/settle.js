// Runs before any script of the page: keeps the page's timers, so that they can be stopped before
// it is measured, and steps those that show pictures in turn, so that every frame is known.
(() => {
  const native = {};
  for (const name of ["setInterval", "setTimeout", "requestAnimationFrame", "clearInterval"]) native[name] = window[name].bind(window);
  const intervals = new Map(), waiting = new Set(), delays = new Map(), cycles = new Map();
  let frozen = false;
  const guarded = (call) => (typeof call === "function" ? (...args) => (frozen ? undefined : call(...args)) : call);
  window.setInterval = (call, delay, ...args) => {
    const id = native.setInterval(guarded(call), delay, ...args);
    if (typeof call === "function") intervals.set(id, [() => call(...args), Number(delay) || 0]);
    return id;
  };
  window.clearInterval = (id) => { intervals.delete(id); native.clearInterval(id); };
  window.setTimeout = (call, delay, ...args) => native.setTimeout(guarded(call), delay, ...args);
  window.requestAnimationFrame = (call) => native.requestAnimationFrame(guarded(call));
  for (const name of ["alert", "confirm", "prompt", "print"]) window[name] = () => (name === "confirm" ? false : undefined);
  window.open = () => null;
  // Ways to other hosts, around what the browser may ask for; a page's text and images need none.
  const ways = ["RTCPeerConnection", "webkitRTCPeerConnection", "WebTransport", "SharedWorker"];
  for (const name of ways) delete window[name];
  delete Navigator.prototype.serviceWorker;
  const pause = (ms) => new Promise((done) => native.setTimeout(done, ms));
  const within = (promise, ms) => Promise.race([promise.catch(() => {}), pause(ms)]);

  // Pictures that wait for their turn: an address beside a placeholder, an element or a noscript in place of one.
  const held = (e, what) => ["data-", "data-lazy-", "data-lazy"].map((name) => e.getAttribute(name + what)).find(Boolean);
  function lazy() {
    for (const e of document.querySelectorAll(".lazy-image-placeholder, :is(span, div, i)[data-src]:empty")) {
      const img = new Image(), size = (name) => e.getAttribute(`data-${name}`) || parseInt(e.style[name], 10) || null;
      img.alt = e.getAttribute("data-alt") || e.getAttribute("alt") || "";
      for (const name of ["width", "height"]) if (size(name)) img.setAttribute(name, parseInt(size(name), 10));
      if (!held(e, "src")) continue;
      if (held(e, "srcset")) img.srcset = held(e, "srcset");
      img.src = held(e, "src");
      waiting.add(img);
      e.replaceWith(img);
    }
    for (const noscript of document.querySelectorAll("body noscript")) {
      if (waiting.has(noscript) || !/<img\b/i.test(noscript.textContent)) continue;
      waiting.add(noscript);
      const img = new DOMParser().parseFromString(noscript.textContent, "text/html").querySelector("img");
      const near = [noscript.previousElementSibling, noscript.nextElementSibling];
      const twin = near.find((e) => e?.tagName === "IMG"), place = near.find((e) => e && /lazy|placeholder/i.test(e.className));
      if (!img || twin && /^https?:/.test(twin.currentSrc) && twin.naturalWidth > 1) continue;
      if (twin && held(twin, "src")) continue;
      if (twin || place) (twin || place).replaceWith(document.adoptNode(img));
      else if (!noscript.parentElement.querySelector("img")) noscript.after(document.adoptNode(img));
    }
    for (const img of document.images) {
      if (img.loading === "lazy") img.loading = "eager";
      const src = held(img, "src") || img.getAttribute("data-original"), set = held(img, "srcset");
      if (!src && !set || waiting.has(img)) continue;
      waiting.add(img);
      for (const source of img.closest("picture")?.querySelectorAll("source") ?? []) {
        if (held(source, "srcset")) source.srcset = held(source, "srcset"); else source.remove();
      }
      if (set) img.srcset = set; else img.removeAttribute("srcset");
      if (src && src !== img.getAttribute("src")) img.src = src;
    }
  }
  // Once from top to bottom, for what loads when it comes into view.
  const scrolled = [];
  async function scrollThrough(end, patience) {
    const frame = () => within(new Promise((done) => { native.requestAnimationFrame(() => native.requestAnimationFrame(done)); }), 200 * patience);
    for (let y = innerHeight; y < document.documentElement.scrollHeight && performance.now() < end; y += innerHeight) {
      scrollTo(0, y);
      await frame();
    }
    scrollTo(0, 0);
    await frame();
  }
  // An address that is the page's own (of an empty src, say) gives no image, however often it is
  // asked for.
  const bare = (url) => url.split("#", 1)[0];
  const named = (img) => img.getAttribute("src") || img.getAttribute("srcset");
  const address = (img) => (named(img) ? img.currentSrc || img.src : "");
  const elsewhere = (url) => /^https?:/.test(url) && bare(url) !== bare(location.href);
  const empty = (img) => img.complete && img.naturalWidth === 0;
  const failed = () => [...document.images].filter((img) => empty(img) && elsewhere(address(img)));
  const loading = () => [...document.images].filter((img) => img.src && !img.complete);

  // Waits until nothing loads or moves. Failed images are told, not asked for again: when that may
  // be is not for the page to decide.
  async function settle(rules) {
    const end = performance.now() + rules.settle_seconds * 1000;
    let height = null, since = performance.now();
    if (!scrolled.length) {
      scrolled.push(true);
      await scrollThrough(end, rules.patience);
    }
    for (;;) {
      lazy();
      // A page that is lower than the window has the window's scrollHeight while it grows.
      const root = document.documentElement;
      const now = performance.now(), tall = root.scrollHeight + root.getBoundingClientRect().height;
      if (tall !== height) { height = tall; since = now; }
      if (!loading().length && now - since >= rules.still_seconds * 1000) break;
      if (now >= end) return { settled: false, failed: [...new Set(failed().map(address))] };
      await pause(50);
    }
    const small = [...document.images].filter((img) => img.naturalWidth * img.naturalHeight <= rules.max_pixels);
    await within(Promise.all(small.map((img) => img.decode().catch(() => {}))), Math.max(0, end - performance.now()));
    if (document.fonts) await within(document.fonts.ready, 1000 * rules.patience);
    return { settled: true, failed: [...new Set(failed().map(address))] };
  }

  // One request for an image that failed, whatever number of elements show it.
  function again(url) {
    for (const img of failed().filter((img) => address(img) === url)) {
      if (img.hasAttribute("srcset")) img.srcset = img.srcset; else img.src = img.src;
    }
  }

  function freeze(rules) {
    frozen = true;
    scrollTo(0, 0);
    for (const animation of document.getAnimations()) {
      try { animation.finish(); } catch { animation.pause(); animation.currentTime = 0; }
    }
    for (const media of document.querySelectorAll("video, audio")) media.pause();
    step(rules);
    for (const slot of document.querySelectorAll(rules.animation)) {
      const name = rules.animation_active, now = slot.querySelector(`:scope > .${name}`);
      if (now && now !== slot.firstElementChild) { now.classList.remove(name); slot.firstElementChild.classList.add(name); }
    }
    // What is fixed to the window would stand in every tile of the picture.
    for (const e of document.querySelectorAll("body *")) {
      const s = getComputedStyle(e);
      if (s.position === "fixed") e.style.setProperty("position", "absolute", "important");
      if (s.position === "sticky") e.style.setProperty("position", "static", "important");
    }
  }
  // One turn of each interval shows what it animates; only those that show pictures in turn are followed.
  function step(rules) {
    const watch = new MutationObserver(() => {});
    watch.observe(document, { subtree: true, attributes: true, childList: true, attributeOldValue: true });
    for (const [call, delay] of intervals.values()) {
      const before = new Map([...document.images].map((img) => [img, img.getAttribute("src")]));
      const turn = () => { try { call(); } catch { /* the page's own fault */ } return watch.takeRecords(); };
      const pictures = new Set();
      for (const change of turn()) {
        const e = change.target;
        const slot = e.nodeType === 1 && e.closest(rules.animation);
        if (slot) delays.set(slot, delay);
        if (e.tagName === "IMG" && change.attributeName === "src" && before.has(e)) pictures.add(e);
      }
      const shown = new Map([...pictures].map((img) => [img, [before.get(img)]]));
      for (let turns = 0; pictures.size && turns < 64; turns++) {
        for (const img of [...pictures]) {
          const src = img.getAttribute("src"), seen = shown.get(img);
          if (seen.includes(src)) pictures.delete(img); else seen.push(src);
        }
        if (pictures.size) turn();
      }
      for (const [img, list] of shown) {
        const first = list.indexOf([...list].sort()[0]);
        const turned = [...list.slice(first), ...list.slice(0, first)];
        cycles.set(img, turned.map((src) => ({ src: new URL(src, document.baseURI).href, duration: delay })));
        if (img.getAttribute("src") !== turned[0]) img.src = turned[0];
      }
    }
    watch.disconnect();
  }

  // What the wiki says which page this is: absent on what is no page of a MediaWiki.
  function identity() {
    const conf = window.mw?.config?.get ? { ...window.RLCONF, ...window.mw.config.get() } : window.RLCONF || {};
    return { page_id: conf.wgArticleId ?? null, revision_id: conf.wgRevisionId ?? null,
      redirected_from: conf.wgRedirectedFrom ?? null };
  }

  const kb = {
    identity,
    delay: (slot) => delays.get(slot) ?? null,
    cycle: (img) => (cycles.get(img)?.length > 1 ? cycles.get(img) : null),
    settle,
    again,
    // Freezes, then waits shortly, as freezing may have moved things.
    freeze: async (rules) => {
      freeze(rules);
      await within(Promise.all([...cycles.keys()].map((img) => img.decode())), 2000);
      await new Promise((done) => { native.requestAnimationFrame(() => native.requestAnimationFrame(done)); native.setTimeout(done, 500 * rules.patience); });
    },
  };
  Object.defineProperty(window, "__kb", { value: kb });
})();
