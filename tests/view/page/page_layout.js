// Returns what is wrong with the layout of the page that is open, as sentences: text that is cut, boxes that overlap,
// text with too little contrast, a scene that panels cover.
() => {
  const wrong = [];
  const SLACK = 1.5;
  const name = (e) => `${e.tagName.toLowerCase()}${e.className && e.className.baseVal === undefined ? "." + e.className.split(" ").slice(-1) : ""} "${(e.textContent || e.getAttribute("alt") || "").trim().slice(0, 40)}"`;
  const panels = [...document.querySelectorAll('[data-dock-region], .mantine-Paper-root[style*="position: fixed"]')];
  const canvas = document.querySelector("canvas[data-engine]").getBoundingClientRect();
  const seen = (e) => e.checkVisibility({ opacityProperty: true, visibilityProperty: true }) && e.getBoundingClientRect().width > 0.5;
  const overlap = (a, b) => Math.min(Math.min(a.right, b.right) - Math.max(a.left, b.left), Math.min(a.bottom, b.bottom) - Math.max(a.top, b.top));

  // The leaves: boxes of text, pictures, charts, inputs.
  const leaves = [];
  for (const panel of panels) {
    for (const e of panel.querySelectorAll("*")) {
      if (!seen(e) || e.closest("svg svg, .u-legend") || e.closest('[data-dock-griphandle], .mantine-Slider-root, script, style')) continue;
      const hasText = [...e.childNodes].some((n) => n.nodeType === 3 && n.textContent.trim());
      const isThing = e.matches("img, .tt-legend svg, .tt-ramp, input, textarea, .uplot, button");
      if (hasText || isThing) leaves.push({ e, panel, hasText });
    }
  }
  // A leaf's box is that of its text, where it has any: a block is as wide as its parent.
  for (const leaf of leaves) {
    if (leaf.hasText && !leaf.e.matches("button, input")) {
      const range = document.createRange();
      range.selectNodeContents(leaf.e);
      leaf.boxes = [...range.getClientRects()];
    } else leaf.boxes = [leaf.e.getBoundingClientRect()];
  }

  // Nothing is cut: a box is inside of everything that clips it, but for what scrolls, of which the visible part counts.
  const styles = new Map();
  const style = (e) => styles.get(e) ?? styles.set(e, getComputedStyle(e)).get(e);
  const intersection = (a, b) => ({ left: Math.max(a.left, b.left), right: Math.min(a.right, b.right), top: Math.max(a.top, b.top), bottom: Math.min(a.bottom, b.bottom) });
  const full = (box) => box.right - box.left > 0 && box.bottom - box.top > 0;
  for (const leaf of leaves) {
    const { e } = leaf;
    const clips = style(e).overflowX !== "visible" || e.matches("pre");
    if (clips && e.scrollWidth > e.clientWidth + 1 && !e.matches("input, td, button")) wrong.push(`cut: ${name(e)}`);
    for (let up = e.parentElement; up && leaf.boxes.length; up = up.parentElement) {
      if (style(up).overflowX === "visible" && style(up).overflowY === "visible") continue;
      const clip = up.getBoundingClientRect();
      const isWide = up.matches(".tt-wide");
      if (!isWide && !e.matches("pre") && leaf.boxes.some((box) => box.left < clip.left - SLACK || box.right > clip.right + SLACK)) {
        wrong.push(`cut at the side: ${name(e)} by ${name(up).slice(0, 40)}`);
        break;
      }
      const scrolls = /auto|scroll/.test(style(up).overflowY) && up.scrollHeight > up.clientHeight + 1;
      if (!scrolls && !isWide && leaf.boxes.some((box) => box.top < clip.top - SLACK || box.bottom > clip.bottom + SLACK)) {
        wrong.push(`cut below or above: ${name(e)} by ${name(up).slice(0, 40)}`);
        break;
      }
      leaf.boxes = leaf.boxes.map((box) => intersection(box, clip)).filter(full);
    }
    if (leaf.boxes.some((box) => box.right > innerWidth + SLACK || box.bottom > innerHeight + SLACK || box.left < -SLACK)) wrong.push(`outside of the window: ${name(e)}`);
  }
  const visible = leaves.filter((leaf) => leaf.boxes.length);

  // No two leaves overlap, unless one contains the other, or both are parts of one input.
  const wrapper = (e) => e.closest(".mantine-Input-wrapper");
  visible.forEach((a, i) => visible.slice(i + 1).forEach((b) => {
    if (a.panel !== b.panel || !a.boxes.some((one) => b.boxes.some((two) => overlap(one, two) > SLACK))) return;
    if (a.e.contains(b.e) || b.e.contains(a.e) || (wrapper(a.e) && wrapper(a.e) === wrapper(b.e))) return;
    wrong.push(`overlap: ${name(a.e)} and ${name(b.e)}`);
  }));

  // Panels cover neither each other nor the scene, and the scene keeps room.
  panels.forEach((one, k) => panels.slice(k + 1).forEach((two) => {
    if (overlap(one.getBoundingClientRect(), two.getBoundingClientRect()) > SLACK) wrong.push("panels overlap");
  }));
  for (const panel of panels) if (overlap(panel.getBoundingClientRect(), canvas) > SLACK) wrong.push(`a panel covers the scene: ${panel.getBoundingClientRect().width} px`);
  const still = (e) => !e.getAnimations({ subtree: true }).some((each) => each.playState === "running");
  const notices = [...document.querySelectorAll(".mantine-Notification-root")].filter(still);
  for (const note of notices) for (const panel of panels) if (overlap(note.getBoundingClientRect(), panel.getBoundingClientRect()) > SLACK) wrong.push(`a notification covers a panel: ${name(note)}`);
  if (canvas.width < 250 || canvas.height < 250) wrong.push(`the scene has only ${canvas.width} x ${canvas.height} px`);
  if (document.documentElement.scrollWidth > innerWidth) wrong.push("the page scrolls sideways");

  // Text and its background, through everything transparent between.
  const paint = document.createElement("canvas").getContext("2d", { willReadFrequently: true });
  const known = {};
  const rgba = (colour) => (known[colour] ??= (() => {
    paint.clearRect(0, 0, 1, 1); paint.fillStyle = colour; paint.fillRect(0, 0, 1, 1);
    const [r, g, b, a] = paint.getImageData(0, 0, 1, 1).data; return [r, g, b, a / 255];
  })());
  const over = (top, under) => top.slice(0, 3).map((c, k) => c * top[3] + under[k] * (1 - top[3]));
  const luminance = (c) => c.map((v) => v / 255).map((v) => (v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4)).reduce((sum, v, k) => sum + v * [0.2126, 0.7152, 0.0722][k], 0);
  const page = document.documentElement.getAttribute("data-mantine-color-scheme") === "dark" ? [36, 36, 36] : [255, 255, 255];
  const background = (e) => {
    const layers = [];
    for (let up = e; up; up = up.parentElement) layers.push(rgba(style(up).backgroundColor));
    return layers.reverse().reduce((under, layer) => over(layer, under), page);
  };
  const notes = notices.flatMap((e) => [...e.querySelectorAll("*")]).filter((e) => seen(e) && [...e.childNodes].some((n) => n.nodeType === 3 && n.textContent.trim())).map((e) => ({ e, hasText: true }));
  for (const { e, hasText } of [...visible, ...notes]) {
    if (!hasText || e.closest(":disabled")) continue;
    let opacity = 1;
    for (let up = e; up; up = up.parentElement) opacity *= Number(style(up).opacity);
    const back = background(e);
    const colour = rgba(style(e).color);
    const [a, b] = [luminance(over([...colour.slice(0, 3), colour[3] * opacity], back)), luminance(back)].sort((x, y) => y - x);
    const ratio = (a + 0.05) / (b + 0.05);
    if (ratio < 4.5) wrong.push(`contrast ${ratio.toFixed(1)}: ${name(e)}`);
  }
  return { wrong: [...new Set(wrong)], leaves: visible.length };
}
