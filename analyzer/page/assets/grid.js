// A table of any length: some forty lines over a spacer, filled with what is in view.
class Grid {
  // host: the element; columns: [{ key, title, least, width, right }], `least` in characters; fetch(from, count) -> { total, rows }; open(row number).
  constructor(host, { label, columns, fetch, open }) {
    Object.assign(this, { columns, fetch, open, total: 0, first: 0, at: 0, asked: 0, isOpen: false });
    const el = Show.el;
    this.head = el("div", { class: "grid-row grid-head", role: "row" },
      ...columns.map((one) => el("span", { role: "columnheader", title: one.help || "", class: one.right ? "n" : "" }, one.title)));
    this.lines = el("div", { class: "grid-lines", role: "presentation" });
    this.spacer = el("div", { class: "grid-spacer", role: "presentation" }, this.lines);
    this.root = el("div", { class: "grid", role: "grid", tabindex: "0", "aria-label": label, "aria-colcount": String(columns.length) },
      el("div", { role: "rowgroup", class: "grid-top" }, this.head), el("div", { role: "rowgroup" }, this.spacer));
    this.root.style.setProperty("--columns", columns.map((one) => one.width).join(" "));
    this.root.style.setProperty("--least", `${columns.reduce((sum, one) => sum + one.least, 0)}ch`);
    host.replaceChildren(this.root);
    this.root.addEventListener("scroll", () => this.scrolled());
    this.root.addEventListener("keydown", (event) => this.pressed(event));
    this.lines.addEventListener("click", (event) => {
      const line = event.target.closest("[data-row]");
      if (line) this.choose(Number(line.dataset.row), true);
    });
    this.resized = new ResizeObserver(() => this.draw(this.first));
    this.resized.observe(this.root);
  }

  static LINE = 24;
  static TALLEST = 8e6;

  // How many whole lines fit under the head.
  get fitting() { return Math.max(1, Math.floor((this.root.clientHeight - Grid.LINE) / Grid.LINE)); }

  // There are as many rows now; `from` jumps to one.
  async show(total, from = this.first) {
    this.total = total;
    this.root.setAttribute("aria-rowcount", String(total + 1));
    this.spacer.style.height = `${Math.min(Grid.TALLEST, total * Grid.LINE)}px`;
    await this.draw(from);
  }

  get lastFirst() { return Math.max(0, this.total - this.fitting); }

  // Follows the scroll bar, unless it stands where `follow` has put it.
  scrolled() {
    if (this.root.scrollTop === this.placed) return;
    this.placed = null;
    const room = this.root.scrollHeight - this.root.clientHeight;
    const share = room > 0 ? this.root.scrollTop / room : 0;
    this.draw(Math.round(share * this.lastFirst), false);
  }

  // Shows the rows from this one on. A newer call wins.
  async draw(from, scroll = true) {
    this.first = Math.max(0, Math.min(from, this.lastFirst));
    if (scroll) this.follow();
    const turn = ++this.asked;
    const { total, rows } = await this.fetch(this.first, this.fitting + 1);
    if (turn !== this.asked) return;
    if (total !== this.total) return void this.show(total);
    this.lines.replaceChildren(...rows.map((cells, place) => this.line(cells, this.first + place)));
    this.root.dataset.first = String(this.first);
  }

  // Puts the scroll bar where the first row is.
  follow() {
    const room = this.root.scrollHeight - this.root.clientHeight;
    this.root.scrollTop = this.lastFirst ? (this.first / this.lastFirst) * room : 0;
    this.placed = this.root.scrollTop;
  }

  line(cells, row) {
    const made = Show.el("div", { class: "grid-row", role: "row", "data-row": String(row), "aria-rowindex": String(row + 2), id: `${this.name()}-${row}` });
    if (row === this.at) made.setAttribute("aria-selected", "true");
    cells.forEach((text, at) => {
      const cell = Show.el("span", { role: "gridcell", class: this.columns[at].right ? "n" : "" }, Show.visible(this.columns[at].show ? this.columns[at].show(text) : text));
      if (this.columns[at].mark) cell.classList.add(...this.columns[at].mark(text));
      made.append(cell);
    });
    return made;
  }

  name() { return this.root.getAttribute("aria-label").toLowerCase(); }

  // Brings the chosen row into view.
  async reveal() {
    if (this.at < this.first) await this.draw(this.at);
    else if (this.at >= this.first + this.fitting) await this.draw(this.at - this.fitting + 1);
  }

  // Chooses a row; once one was opened, what is open follows.
  async choose(row, opens) {
    this.isOpen ||= opens;
    this.at = Math.max(0, Math.min(row, this.total - 1));
    await this.reveal();
    for (const line of this.lines.children) {
      const chosen = Number(line.dataset.row) === this.at;
      line.toggleAttribute("aria-selected", chosen);
      if (chosen) line.setAttribute("aria-selected", "true");
    }
    this.root.setAttribute("aria-activedescendant", `${this.name()}-${this.at}`);
    if (this.isOpen && this.total) this.open(this.at);
  }

  pressed(event) {
    const steps = { ArrowDown: 1, ArrowUp: -1, PageDown: this.fitting, PageUp: -this.fitting, Home: -this.total, End: this.total };
    if (event.key === "Enter") return void this.choose(this.at, true);
    if (!(event.key in steps)) return;
    event.preventDefault();
    this.choose(this.at + steps[event.key], event.shiftKey);
  }
}
