"""What a browser shows of a page: labels that overlap, what is cut or cannot be read, what is wider than the page."""

from collections.abc import Iterator
from pathlib import Path

WIDTHS, SCHEMES = (1440, 1000, 400), ("light", "dark")
MISTAKES = """() => {
  const found = [], shown = (e) => e.checkVisibility() && e.getBoundingClientRect().width > 0;
  const words = (e) => (e.textContent || e.tagName).trim().slice(0, 30);
  const part = (value) => (value /= 255) <= 0.04045 ? value / 12.92 : ((value + 0.055) / 1.055) ** 2.4;
  const light = (colour) => {
    const [r, g, b] = colour.match(/[\\d.]+/g).map(Number);
    return 0.2126 * part(r) + 0.7152 * part(g) + 0.0722 * part(b) + 0.05;
  };
  const ground = (e) => {
    for (; e; e = e.parentElement) {
      const colour = getComputedStyle(e).backgroundColor;
      if (!/, 0\\)|transparent/.test(colour)) return colour;
    }
    return "rgb(255, 255, 255)";
  };
  const reads = (e, colour) => {
    const [a, b] = [light(colour), light(ground(e))];
    return Math.max(a, b) / Math.min(a, b);
  };
  if (document.documentElement.scrollWidth > innerWidth) found.push("the page is wider than the screen");
  for (const svg of [...document.querySelectorAll("figure svg")].filter(shown)) {
    const whole = svg.getBoundingClientRect();
    const texts = [...svg.querySelectorAll("text")].filter(shown).map((e) => [e, e.getBoundingClientRect()]);
    texts.forEach(([e, a], k) => {
      if (a.left < whole.left - 1 || a.right > whole.right + 1 || a.top < whole.top - 1 || a.bottom > whole.bottom + 1)
        found.push(`cut: ${words(e)}`);
      if (reads(svg, getComputedStyle(e).fill) < 2.7) found.push(`too pale: ${words(e)}`);
      for (const [other, b] of texts.slice(k + 1)) {
        const wide = Math.min(a.right, b.right) - Math.max(a.left, b.left);
        const high = Math.min(a.bottom, b.bottom) - Math.max(a.top, b.top);
        if (wide > 1 && high > 0.25 * Math.min(a.height, b.height)) found.push(`${words(e)} on ${words(other)}`);
      }
    });
    for (const e of svg.querySelectorAll("[style*='var('], [fill^='var('], [stroke^='var(']"))
      for (const [, name] of e.outerHTML.split(">")[0].matchAll(/var\\((--[\\w-]+)\\)/g))
        if (!getComputedStyle(e).getPropertyValue(name)) found.push(`no colour ${name}`);
  }
  for (const e of [...document.querySelectorAll("h1, h2, p, td, th, figcaption, footer")].filter(shown)) {
    if (e.scrollWidth > e.clientWidth + 1 && getComputedStyle(e).display !== "inline") found.push(`cut: ${words(e)}`);
    if (words(e) && reads(e, getComputedStyle(e).color) < 4.4) found.push(`too pale: ${words(e)}`);
  }
  return [...new Set(found)];
}"""
"""What is wrong, as seen by the page's own boxes and colours."""


def screens(browser, file: Path, wrong: list[str], without: str = "") -> Iterator[tuple[str, object]]:
    """Each screen on which a file is shown, by name; requests to any host are mistakes, ``without`` is not fetched."""
    page = browser.new_page()

    def route(route):
        url = route.request.url
        if without and without in url:
            route.abort()
        elif url.startswith(("file:", "data:")):
            route.continue_()
        else:
            wrong.append(f"{file.name} asks {url}")
            route.abort()

    page.route("**/*", route)
    page.on("pageerror", lambda error: wrong.append(f"{file.name}: {error}"))
    for scheme in SCHEMES:
        page.emulate_media(color_scheme=scheme)
        page.goto(file.as_uri())
        for width in WIDTHS:
            page.set_viewport_size({"width": width, "height": 900})
            yield f"{file.stem} {width} {scheme}", page
    page.close()


def mistakes(browser, file: Path, *, without: str = "", folder: Path | None = None) -> list[str]:
    """What is wrong with a page on all screens; pictures of it go to ``folder``."""
    wrong: list[str] = []
    for name, page in screens(browser, file, wrong, without):
        wrong += [f"{name}: {each}" for each in page.evaluate(MISTAKES)]
        if folder:
            page.screenshot(path=folder / f"{name.replace(' ', '-')}.png", full_page=True)
    return wrong
