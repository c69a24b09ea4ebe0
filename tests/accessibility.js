// What blind and weak-sighted readers of the shown page would miss, one line each (WCAG 2.2, AA).
() => {
  const found = [];
  const shown = (element) => element.checkVisibility({ visibilityProperty: true });
  const all = (selector) => [...document.querySelectorAll(selector)].filter(shown);
  const where = (element) => element.outerHTML.slice(0, 80);

  if (!document.documentElement.lang) found.push("html: no lang");
  if (!document.title) found.push("no title");
  if (all("main").length !== 1) found.push("not one main");
  if (all("h1").length !== 1) found.push("not one h1");
  let level = 1;
  for (const heading of all("h1, h2, h3, h4")) {
    const own = Number(heading.tagName[1]);
    if (own > level + 1) found.push(`heading skips a level: ${where(heading)}`);
    level = own;
  }
  for (const picture of all("img")) if (!picture.alt.trim()) found.push(`no alt: ${where(picture)}`);
  for (const drawing of all("svg")) {
    if (drawing.getAttribute("role") !== "img" || !drawing.getAttribute("aria-label")) found.push(`svg: ${where(drawing)}`);
  }
  for (const control of all("input, select, progress")) {
    const named = control.getAttribute("aria-label") || [...control.labels].some((l) => l.textContent.trim());
    if (!named) found.push(`no label: ${where(control)}`);
  }
  for (const button of all("button, a[href], summary")) {
    if (!button.textContent.trim()) found.push(`says nothing: ${where(button)}`);
  }
  for (const table of all("table")) {
    if (table.querySelectorAll("th[scope=col]").length === 0) found.push(`no column headings: ${where(table)}`);
  }
  const ids = [...document.querySelectorAll("[id]")].map((element) => element.id);
  for (const id of ids) if (ids.indexOf(id) !== ids.lastIndexOf(id)) found.push(`id twice: ${id}`);

  // Contrast of text: relative luminances by WCAG's formula, over the nearest opaque background.
  const channels = (colour) => colour.match(/[\d.]+/g).map(Number);
  const luminance = ([red, green, blue]) => {
    const [r, g, b] = [red, green, blue].map((c) => (c /= 255) <= 0.04045 ? c / 12.92 : ((c + 0.055) / 1.055) ** 2.4);
    return 0.2126 * r + 0.7152 * g + 0.0722 * b;
  };
  const background = (element) => {
    for (let e = element; e; e = e.parentElement) {
      const colour = channels(getComputedStyle(e).backgroundColor);
      if (colour.length < 4 || colour[3] === 1) return colour;
    }
    return [255, 255, 255];
  };
  for (const element of all("body *")) {
    const texts = [...element.childNodes].some((n) => n.nodeType === Node.TEXT_NODE && n.data.trim());
    if (!texts || element.closest("script, style, select, :disabled")) continue;
    const style = getComputedStyle(element);
    const ink = channels(element.closest("svg") ? style.fill : style.color);
    const [dark, light] = [luminance(ink), luminance(background(element))].sort((a, b) => a - b);
    const ratio = (light + 0.05) / (dark + 0.05);
    if (ratio < 4.5) found.push(`contrast ${ratio.toFixed(2)}: ${where(element)}`);
  }
  return found;
}
