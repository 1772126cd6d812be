"""A real browser, and what every page of the project must keep in it."""

# Contrast of text with what lies behind it, by WCAG; 4.5 is what normal text needs.
CONTRAST = """
() => {
  const linear = (x) => x <= .04045 ? x / 12.92 : ((x + .055) / 1.055) ** 2.4;
  const light = (c) => { const v = c.map((x) => linear(x / 255));
    return .2126 * v[0] + .7152 * v[1] + .0722 * v[2]; };
  const parse = (text) => text.match(/[\\d.]+/g).map(Number);
  const behind = (node) => { for (; node; node = node.parentElement) {
    const c = parse(getComputedStyle(node).backgroundColor); if (c.length < 4 || c[3] === 1) return c; }
    return [255, 255, 255]; };
  const poor = [];
  for (const node of document.querySelectorAll('p, td, th, h1, h2, h3, a, li, dd, dt, pre, .side span, svg text')) {
    const style = getComputedStyle(node), text = parse(node.closest('svg') ? style.fill : style.color);
    if (node.closest('figure.confusion')) continue;  // its numbers stand on cells, see below
    const [a, b] = [light(text), light(behind(node))].sort((x, y) => y - x);
    if ((a + .05) / (b + .05) < 4.5) poor.push([node.tagName, node.textContent.slice(0, 40), (a + .05) / (b + .05)]);
  }
  return poor;
}
"""


def watch(page):
    """Collect what a page says on its console, what it asks for, and where it breaks its policy."""
    page.messages, page.requests = [], []
    page.on("console", lambda message: page.messages.append(message.text))
    page.on("pageerror", lambda error: page.messages.append(str(error)))
    page.on("request", lambda request: page.requests.append(request.url))
    page.add_init_script(
        "window.violations = []; document.addEventListener('securitypolicyviolation', "
        "(e) => window.violations.push(e.violatedDirective))"
    )
