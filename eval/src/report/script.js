"use strict";
(function () {
  function all(root, selector) { return Array.prototype.slice.call(root.querySelectorAll(selector)); }

  // Curves: press a key to hide its curve, point at it to bring it out.
  all(document, ".plot").forEach(function (plot) {
    all(plot, ".key").forEach(function (key) {
      var series = plot.querySelector('.series[data-series="' + key.dataset.series + '"]');
      function hot(on) { series.classList.toggle("hot", on); plot.classList.toggle("any-hot", on); }
      key.addEventListener("click", function () {
        series.classList.toggle("off", key.getAttribute("aria-pressed") === "true");
        key.setAttribute("aria-pressed", String(!series.classList.contains("off")));
      });
      key.addEventListener("mouseenter", function () { hot(true); });
      key.addEventListener("mouseleave", function () { hot(false); });
      key.addEventListener("focus", function () { hot(true); });
      key.addEventListener("blur", function () { hot(false); });
    });
  });

  // Features: press a key to hide its class.
  all(document, ".picture").forEach(function (picture) {
    all(picture, ".key").forEach(function (key) {
      key.addEventListener("click", function () {
        var hidden = picture.querySelector("svg.scene").classList.toggle("hide-" + key.dataset.hides);
        key.setAttribute("aria-pressed", String(!hidden));
      });
    });
  });

  // Tables: a heading sorts its column. A matrix has its order.
  all(document, "table:not(.confusion)").forEach(function (table) {
    all(table, "thead th").forEach(function (head, column) {
      if (!head.querySelector("button")) {
        var press = document.createElement("button");
        press.type = "button";
        while (head.firstChild) { press.appendChild(head.firstChild); }
        head.appendChild(press);
      }
      var button = head.querySelector("button");
      button.addEventListener("click", function () {
        var up = head.getAttribute("aria-sort") !== "ascending";
        all(table, "thead th").forEach(function (other) { other.removeAttribute("aria-sort"); });
        head.setAttribute("aria-sort", up ? "ascending" : "descending");
        function value(row) {
          var cell = row.cells[column];
          if (!cell) { return ""; }
          var text = cell.textContent.trim();
          var number = parseFloat(cell.dataset.v || text.replace("\u2212", "-"));
          return isNaN(number) ? text : number;
        }
        var body = table.tBodies[0];
        all(body, "tr").map(function (row, at) { return { row: row, at: at, value: value(row) }; })
          .sort(function (a, b) {
            var order = typeof a.value === typeof b.value
              ? (a.value < b.value ? -1 : a.value > b.value ? 1 : 0)
              : (typeof a.value === "number" ? -1 : 1);
            return (up ? order : -order) || a.at - b.at;
          })
          .forEach(function (entry) { body.appendChild(entry.row); });
      });
    });
  });

  // The summary shows one n at a time.
  all(document, "select[data-filters]").forEach(function (select) {
    function show() {
      var table = document.getElementById(select.dataset.filters);
      table.classList.toggle("one-n", select.value !== "");
      var largest = 1;
      all(table, "tbody tr").forEach(function (row) {
        row.hidden = select.value !== "" && row.dataset.n !== select.value;
        if (!row.hidden) { largest = Math.max(largest, parseFloat(row.dataset.high)); }
      });
      table.style.setProperty("--scale", largest);
    }
    select.addEventListener("change", show);
    show();
  });

  document.documentElement.dataset.ready = "yes";
})();
