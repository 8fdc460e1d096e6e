'use strict';
{
  const byId = (id) => document.getElementById(id);
  const data = JSON.parse(byId('data').textContent);
  const runs = data.runs.map((run) => ({
    ...run,
    rows: run.rows.map((row, place) => ({ place, ...Object.fromEntries(row.map((value, at) => [data.fields[at], value])) })),
  }));
  const kinds = ['all', 'right', 'wrong', 'rejected', 'skipped'];
  const kindNames = { all: 'All', right: 'Right', wrong: 'Wrong', rejected: 'Rejected', skipped: 'No candidate' };
  const namespace = 'http://www.w3.org/2000/svg';
  const now = { run: runs[0], kind: 'all', shown: [], at: 0 };

  // The colour scheme: the system's, unless it was chosen here.

  const schemes = ['auto', 'light', 'dark'];
  const schemeNames = { auto: 'as the system', light: 'light', dark: 'dark' };

  function setScheme(scheme) {
    document.documentElement.dataset.scheme = scheme;
    byId('scheme').textContent = scheme[0].toUpperCase() + scheme.slice(1);
    byId('scheme').setAttribute('aria-label', `Colour scheme: ${schemeNames[scheme]}`);
  }

  function storedScheme() {
    try {
      return schemes.find((scheme) => scheme === localStorage.getItem('scheme')) || 'auto';
    } catch {
      return 'auto';
    }
  }

  byId('scheme').addEventListener('click', () => {
    const scheme = schemes[(schemes.indexOf(document.documentElement.dataset.scheme) + 1) % 3];
    setScheme(scheme);
    try {
      localStorage.setItem('scheme', scheme);
    } catch {
      // A page opened as a file may not be allowed to remember.
    }
  });

  // Tables: a heading sorts, again the other way round; numbers first from high to low.

  function sortBy(heading) {
    const table = heading.closest('table');
    const column = heading.cellIndex;
    const numeric = heading.classList.contains('number');
    const before = heading.getAttribute('aria-sort');
    const first = numeric ? 'descending' : 'ascending';
    const order = before === first ? { ascending: 'descending', descending: 'ascending' }[first] : first;
    const key = (row) => {
      const cell = row.cells[column];
      return numeric ? (cell.dataset.value === '' ? null : Number(cell.dataset.value)) : cell.textContent;
    };
    const sign = order === 'ascending' ? 1 : -1;
    const compare = (one, other) => {
      const [a, b] = [key(one), key(other)];
      if (a === null || b === null) return (a === null) - (b === null);
      return sign * (numeric ? a - b : a.localeCompare(b, undefined, { numeric: true }));
    };
    table.tBodies[0].append(...[...table.tBodies[0].rows].sort(compare));
    for (const other of heading.parentNode.cells) other.setAttribute('aria-sort', 'none');
    heading.setAttribute('aria-sort', order);
  }

  for (const button of document.querySelectorAll('table.sortable thead button')) {
    button.addEventListener('click', () => sortBy(button.closest('th')));
  }

  // A method under the pointer, or focused in the legend, stands out in all charts of its set.

  function pick(section, series) {
    section.classList.toggle('picking', series !== undefined);
    for (const item of section.querySelectorAll('[data-series]')) {
      item.classList.toggle('picked', item.dataset.series === series);
    }
  }

  for (const section of document.querySelectorAll('section.set')) {
    for (const item of section.querySelectorAll('[data-series]')) {
      for (const event of ['pointerenter', 'focus']) item.addEventListener(event, () => pick(section, item.dataset.series));
      for (const event of ['pointerleave', 'blur']) item.addEventListener(event, () => pick(section));
    }
  }

  // The browser of matched pairs.

  const isKind = (row, kind) => kind === 'all' || row.verdict === kind;
  const digits = (value, number) => (value === null ? '–' : value.toFixed(number));
  const words = (name) => name.replaceAll('_', ' ');

  function distance(frames) {
    const number = Math.abs(frames);
    return number ? `${number} ${number === 1 ? 'frame' : 'frames'} from the match` : 'the match itself';
  }

  function told(row) {
    const half = row.half ? ` Only the ${row.half} half of the map was kept.` : '';
    const absent = 'this place is not in the map';
    if (!row.known && row.verdict === 'rejected') return `Rightly rejected (${words(row.reason)}): ${absent}.${half}`;
    const place = row.known ? '' : ` In truth ${absent}.`;
    const sayings = {
      right: 'Right: accepted, and within the tolerance.',
      wrong: row.slip ? 'Wrong, by a slip: 1 to 3 frames beyond the tolerance.' : 'Wrong: accepted, and another place.',
      rejected: `Rejected (${words(row.reason)}): the best candidate ${row.correct ? 'would have been right' : 'is wrong'}.`,
      skipped: `No candidate: ${words(row.reason)}.`,
    };
    return sayings[row.verdict] + place + half;
  }

  function showPicture(id, number, text) {
    const image = byId(id);
    image.hidden = number === null;
    image.alt = number === null ? '' : text;
    if (number === null) image.removeAttribute('src');
    else image.src = data.pictures[number];
  }

  function caption(id, heading, ...details) {
    const lines = details.filter(Boolean).map((detail) => {
      const small = document.createElement('small');
      small.textContent = detail;
      return small;
    });
    byId(`${id}-caption`).replaceChildren(heading, ...lines);
  }

  // Inliers, coloured as on ~/debug_image: by where in the query they are.

  function drawDots(id, dots, at) {
    const image = byId(id);
    const plate = image.nextElementSibling;
    const [width, height] = [image.naturalWidth, image.naturalHeight];
    plate.setAttribute('viewBox', `0 0 ${width || 1} ${height || 1}`);
    const shown = byId('dots').checked && !image.hidden && width ? dots.length / 4 : 0;
    plate.replaceChildren(...Array.from({ length: shown }, (_, index) => {
      const [row, column] = [dots[4 * index + at], dots[4 * index + at + 1]];
      const dot = document.createElementNS(namespace, 'circle');
      const shape = { cx: column / 255 * width, cy: row / 255 * height, r: width / 130, fill: `hsl(${300 / 255 * dots[4 * index + 1]} 100% 61%)` };
      for (const [name, value] of Object.entries(shape)) dot.setAttribute(name, value);
      return dot;
    }));
  }

  function showDots(row) {
    const dots = Uint8Array.from(atob(row ? row.dots : ''), (byte) => byte.charCodeAt(0));
    for (const [id, at] of [['query', 0], ['match', 2]]) {
      byId(id).onload = () => drawDots(id, dots, at);
      drawDots(id, dots, at);
    }
  }

  function address() {
    const row = now.shown[now.at];
    const frame = row && !row.half ? row.query : `${row ? row.place : 0}.`;
    const parts = [now.run.set, now.run.method, frame];
    if (now.kind !== 'all') parts.push(now.kind);
    return `#${parts.map(encodeURIComponent).join('/')}`;
  }

  function show(at, remember = true) {
    now.at = Math.max(0, Math.min(at, now.shown.length - 1));
    const row = now.shown[now.at];
    const none = { verdict: 'skipped', query_picture: null, best_picture: null, truth_picture: null };
    const { verdict, query_picture, best_picture, truth_picture } = row || none;
    byId('slider').value = now.at;
    byId('previous').disabled = now.at <= 0;
    byId('next').disabled = now.at >= now.shown.length - 1;
    byId('count').textContent = row ? `${now.at + 1} of ${now.shown.length}` : 'none';
    byId('verdict').className = `verdict ${verdict}`;
    byId('verdict').textContent = row ? told(row) : 'No frame of this kind.';
    byId('match-frame').className = `photo ${verdict}`;
    showPicture('query', query_picture, row && `Query frame ${row.query}`);
    showPicture('match', best_picture, row && `Best candidate, reference ${row.best}`);
    showPicture('truth', truth_picture, row && `Truth, reference ${row.truth}`);
    showDots(row);
    if (row) {
      byId('slider').setAttribute('aria-valuetext', `query ${row.query}, ${verdict}`);
      caption('query', `Query ${row.query}`, `k ${row.length || '–'}, entropy ${digits(row.entropy, 3)}`);
      caption('match', row.best === null ? 'No match' : `Match: reference ${row.best}`, `score ${digits(row.score, 4)}, margin ${digits(row.margin, 4)}, inliers ${row.inliers ?? '–'}`, row.pose);
      caption('truth', row.truth === null ? 'Truth: not in the map' : `Truth: reference ${row.truth}${row.known ? '' : ', left out of this map'}`, row.truth === null || row.best === null ? '' : distance(row.truth - row.best));
    } else {
      for (const id of ['query', 'match', 'truth']) caption(id, '', '');
    }
    const here = byId('strip').querySelector('.here');
    if (here) here.setAttribute('x', row ? row.place : -9);
    if (remember) history.replaceState(null, '', address());
  }

  function drawStrip() {
    const strip = byId('strip');
    strip.setAttribute('viewBox', `0 0 ${now.run.rows.length} 10`);
    const bars = now.run.rows.map((row, at) => {
      const bar = document.createElementNS(namespace, 'rect');
      const shape = { x: at, y: isKind(row, now.kind) ? 0 : 7, width: 1, height: isKind(row, now.kind) ? 10 : 3, class: row.verdict };
      for (const [name, value] of Object.entries(shape)) bar.setAttribute(name, value);
      return bar;
    });
    const here = document.createElementNS(namespace, 'rect');
    for (const [name, value] of Object.entries({ x: 0, y: 0, width: 1, height: 10, class: 'here' })) here.setAttribute(name, value);
    strip.replaceChildren(...bars, here);
  }

  function choose(run, kind, row, remember = true) {
    now.run = run;
    now.kind = kind;
    now.shown = run.rows.filter((one) => isKind(one, kind));
    byId('run').value = runs.indexOf(run);
    byId('slider').max = Math.max(0, now.shown.length - 1);
    for (const button of byId('filters').children) {
      const { kind: own } = button.dataset;
      button.setAttribute('aria-pressed', own === kind);
      button.textContent = `${kindNames[own]} ${run.rows.filter((one) => isKind(one, own)).length}`;
    }
    drawStrip();
    show(nearest(row), remember);
  }

  function nearest(row) {
    if (!row) return 0;
    const gap = (at) => Math.abs(now.shown[at].place - row.place);
    return now.shown.reduce((best, one, at) => (gap(at) < gap(best) ? at : best), 0);
  }

  function rowOf(run, query) {
    if (query.endsWith('.')) return run.rows[parseInt(query, 10)];
    const wanted = Number(query);
    const close = (row) => Math.abs(row.query - wanted);
    return run.rows.reduce((best, row) => (close(row) < close(best) ? row : best), run.rows[0]);
  }

  // A right match tells most at first sight, then a wrong one, then one that was rejected.

  function telling(run) {
    return kinds.map((kind) => run.rows.find((row) => row.verdict === kind)).find(Boolean);
  }

  function follow() {
    const [set, method, query, kind] = location.hash.slice(1).split('/').map((part) => {
      try {
        return decodeURIComponent(part);
      } catch {
        return part;
      }
    });
    const run = runs.find((one) => one.set === set && one.method === method);
    if (!run) return false;
    choose(run, kinds.includes(kind) ? kind : 'all', query === undefined ? telling(run) : rowOf(run, query), false);
    return true;
  }

  function goThere() {
    if (follow()) byId('pairs').scrollIntoView();
  }

  byId('run').append(...runs.map((run, at) => new Option(`${run.set} / ${run.method}`, at)));
  byId('run').addEventListener('change', () => {
    const query = now.shown[now.at] ? String(now.shown[now.at].query) : '0';
    const run = runs[byId('run').value];
    choose(run, now.kind, rowOf(run, query));
  });
  byId('filters').append(...kinds.map((kind) => {
    const button = document.createElement('button');
    button.type = 'button';
    button.dataset.kind = kind;
    button.addEventListener('click', () => choose(now.run, kind, now.shown[now.at]));
    return button;
  }));
  byId('slider').addEventListener('input', () => show(Number(byId('slider').value)));
  byId('dots').addEventListener('change', () => showDots(now.shown[now.at]));
  byId('previous').addEventListener('click', () => show(now.at - 1));
  byId('next').addEventListener('click', () => show(now.at + 1));
  byId('strip').addEventListener('click', (event) => {
    const box = byId('strip').getBoundingClientRect();
    const place = Math.floor((event.clientX - box.left) / box.width * now.run.rows.length);
    show(nearest(now.run.rows[Math.max(0, Math.min(place, now.run.rows.length - 1))]));
  });
  document.addEventListener('keydown', (event) => {
    const step = { ArrowLeft: -1, ArrowRight: 1 }[event.key];
    const busy = event.target.closest?.('input, select, textarea, .scroll, nav');
    if (!step || busy || event.altKey || event.ctrlKey || event.metaKey || event.shiftKey) return;
    event.preventDefault();
    show(now.at + step);
  });
  for (const plate of document.querySelectorAll('.plate')) {
    plate.addEventListener('click', (event) => {
      const box = plate.querySelector('image').getBoundingClientRect();
      const share = Math.max(0, Math.min((event.clientY - box.top) / box.height, 0.9999));
      const query = Math.floor(share * Number(plate.dataset.queries));
      location.hash = `${plate.dataset.run}/${query}`;
    });
  }
  window.addEventListener('hashchange', goThere);

  setScheme(storedScheme());
  choose(runs[0], 'all', telling(runs[0]), false);
  goThere();
}
