"use strict";
(function () {
  var findings = [];
  function all(selector) { return Array.prototype.slice.call(document.querySelectorAll(selector)); }
  function found(what, where) { findings.push(what + ": " + (where.textContent || "").trim().slice(0, 40)); }

  // Every heading of every table but matrices sorts, up and then down.
  var sorted = 0;
  all("table:not(.confusion)").forEach(function (table) {
    Array.prototype.forEach.call(table.tHead.rows[0].cells, function (head, column) {
      var button = head.querySelector("button");
      if (!button) { found("a heading that is no button", head); return; }
      function values() {
        return Array.prototype.map.call(table.tBodies[0].rows, function (row) {
          var cell = row.cells[column];
          var text = cell.textContent.trim().replace("\u2212", "-");
          var number = parseFloat(cell.dataset.v || text);
          return isNaN(number) ? text : number;
        });
      }
      function inOrder(sign) {
        var seen = values();
        return seen.every(function (value, at) {
          var before = seen[at - 1];
          return at === 0 || typeof value !== typeof before || sign * (value > before) >= sign * (value < before);
        });
      }
      button.click();
      if (head.getAttribute("aria-sort") !== "ascending" || !inOrder(1)) { found("not ascending", head); }
      button.click();
      if (head.getAttribute("aria-sort") !== "descending" || !inOrder(-1)) { found("not descending", head); }
    });
    sorted += 1;
  });
  document.querySelector(".plot .key").click();

  // Every picture has a text or says that it needs none.
  all("img, svg").forEach(function (picture) {
    var isHidden = picture.closest("[aria-hidden=true]");
    var text = picture.getAttribute("alt") || picture.getAttribute("aria-label");
    if (!isHidden && !text) { found("a picture without text", picture.parentElement); }
  });
  all("button, select").forEach(function (control) {
    var label = control.textContent.trim() || control.getAttribute("aria-label");
    if (!label) { found("a control without text", control.parentElement); }
  });

  // Contrast of texts (WCAG 2: 4.5, large ones 3) against the nearest background that is not transparent.
  function channels(colour) { return colour.match(/[\d.]+/g).map(Number); }
  function luminance(rgb) {
    var linear = rgb.slice(0, 3).map(function (value) {
      value /= 255;
      return value <= 0.04045 ? value / 12.92 : Math.pow((value + 0.055) / 1.055, 2.4);
    });
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2];
  }
  function background(element) {
    for (; element; element = element.parentElement) {
      var colour = channels(getComputedStyle(element).backgroundColor);
      if (colour.length < 4 || colour[3] === 1) { return colour; }
    }
    return [255, 255, 255];
  }
  all("h1, h2, h3, p, td, th, dt, dd, a, button, summary, figcaption, small, svg text, .sub, .num, .name")
    .forEach(function (element) {
      var hasText = Array.prototype.some.call(element.childNodes, function (node) {
        return node.nodeType === 3 && node.textContent.trim();
      });
      // Cells of a matrix mix their colours, pressed keys are dimmed to look switched off.
      if (!hasText || element.closest(".confusion, [aria-pressed=false], .f")) { return; }
      var style = getComputedStyle(element);
      var isDrawn = element instanceof SVGElement;
      var text = luminance(channels(isDrawn ? style.fill : style.color));
      var behind = luminance(background(element));
      var contrast = (Math.max(text, behind) + 0.05) / (Math.min(text, behind) + 0.05);
      var needed = parseFloat(style.fontSize) >= 24 ? 3 : 4.5;
      if (contrast < needed) { found("contrast " + contrast.toFixed(2), element); }
    });

  // Only boxes that say so scroll sideways.
  if (document.documentElement.scrollWidth > window.innerWidth + 1) {
    findings.push("the page is " + document.documentElement.scrollWidth + " px wide in " + window.innerWidth);
  }

  var root = document.documentElement;
  root.dataset.mode = luminance(background(document.body)) > 0.5 ? "light" : "dark";
  root.dataset.sorted = String(sorted);
  root.dataset.findings = findings.length ? findings.slice(0, 8).join(" | ") : "none";
})();
