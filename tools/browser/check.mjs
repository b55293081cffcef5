// What tools/browser.py has a browser do. One argument: JSON with what to open and where pictures go. Prints JSON with what was seen; whoever started this judges.

import http from 'node:http';
import fs from 'node:fs';
import path from 'node:path';
import { spawn } from 'node:child_process';
import { chromium } from 'playwright-core';

const asked = JSON.parse(process.argv[2]);
const ARGUMENTS = ['--no-sandbox', '--disable-dev-shm-usage', '--use-gl=angle', '--use-angle=swiftshader', '--enable-unsafe-swiftshader'];
const browser = await chromium.launch({ executablePath: asked.chromium, headless: true, args: ARGUMENTS });
const [WIDTH, HEIGHT, WAIT] = [900, 700, 120_000];

/// A page of its own, and what it says and asks for.
async function opened(options = {}) {
    const context = await browser.newContext({ viewport: { width: WIDTH, height: HEIGHT }, ...options });
    const page = await context.newPage(), heard = { errors: [], requests: [] };
    page.on('console', message => { if (['error', 'warning'].includes(message.type())) heard.errors.push(message.text()); });
    page.on('pageerror', error => heard.errors.push(String(error)));
    page.on('request', request => heard.requests.push(request.url()));
    page.setDefaultTimeout(WAIT);
    return { page, heard, context };
}

const idle = page => page.waitForFunction(() => window.viewer && viewer.stats.idle && viewer.stats.triangles > 0);
// After a change: what was drawn before it may be idle still.
const settled = async (page, change) => {
    const from = await page.evaluate(() => viewer.stats.frames);
    await change();
    await page.waitForFunction(from => viewer.stats.frames > from && viewer.stats.idle && viewer.stats.triangles > 0, from);
};
// The canvas as it is drawn, without what lies over it: only while a frame is drawn does it hold a picture.
const canvas = async (page, name) => {
    const url = await page.evaluate(() => new Promise(done => {
        viewer.onframe = () => { viewer.onframe = null; done(document.querySelector('canvas').toDataURL()); };
        viewer.look({});
    }));
    const png = Buffer.from(url.split(',')[1], 'base64');
    if (name) fs.writeFileSync(path.join(asked.pictures, name), png);
    return png;
};
const stats = page => page.evaluate(() => ({ ...viewer.stats, choices: viewer.choices(), eye: viewer.eye() }));

/// Starts `view`; gives its address, and how long it took to tell.
async function viewed(what) {
    const start = performance.now();
    const child = spawn(asked.program, ['view', what, '--no-open', '-q'], { stdio: ['ignore', 'pipe', 'inherit'] });
    const address = await new Promise((done, failed) => {
        child.stdout.once('data', bytes => done(String(bytes).trim()));
        child.once('exit', code => failed(new Error(`view ${what}: exit code ${code}`)));
    });
    const ended = () => new Promise(done => { child.removeAllListeners('exit'); child.once('exit', done); child.kill('SIGINT'); });
    return { address, ended, start, ready: performance.now() - start };
}

const out = {};

// 1. The viewer on a tileset.
{
    const { address, ended, start, ready } = await viewed(asked.tileset);
    const { page, heard, context } = await opened();
    await page.goto(address);
    await page.waitForFunction(() => window.viewer && viewer.stats.triangles > 0);
    out.first = { ready, picture: performance.now() - start };
    await idle(page);
    out.begun = await stats(page);
    await page.screenshot({ path: path.join(asked.pictures, 'whole.png') });
    // As `render` sees it: from the same direction, in parallel, all of it, as fine as it comes.
    out.directions = [];
    for (const [azimuth, elevation] of asked.directions) {
        await settled(page, () => page.evaluate(([azimuth, elevation]) => { viewer.set({ colour: '', detail: 100 }); viewer.look({ azimuth, elevation, parallel: true, fit: true }); }, [azimuth, elevation]));
        const name = `seen-${azimuth}-${elevation}.png`;
        await canvas(page, name);
        out.directions.push({ azimuth, elevation, name, stats: await stats(page) });
    }
    // Turning with the mouse.
    await settled(page, () => page.evaluate(() => { viewer.set({ detail: 60 }); viewer.look({ azimuth: 305, elevation: 30, parallel: false, fit: true }); }));
    const before = await canvas(page, 'turn-0.png');
    await page.mouse.move(600, 400);
    await page.mouse.down();
    await page.mouse.move(700, 380, { steps: 5 });
    await page.mouse.up();
    await idle(page);
    out.turned = { eye: (await stats(page)).eye, changed: !before.equals(await canvas(page, 'turn-1.png')) };
    await page.keyboard.press('h');
    await idle(page);
    out.home = { eye: (await stats(page)).eye, same: before.equals(await canvas(page, 'turn-2.png')) };
    // Colours, chosen as people do.
    out.colours = {};
    for (const choice of ['', 'height', 'COLOR_0', '_CLASSIFICATION', '_INTENSITY'].filter(choice => out.begun.choices.includes(choice))) {
        await page.selectOption('select', choice);
        await page.waitForTimeout(100);
        const name = `colour-${choice || 'plain'}.png`;
        await canvas(page, name);
        out.colours[choice] = { name, legend: await page.textContent('.legend') };
    }
    // Wires, a question, a distance.
    await page.selectOption('select', '');
    const plain = await canvas(page);
    await page.getByLabel('Wireframe').check();
    out.wires = !plain.equals(await canvas(page, 'wires.png'));
    await page.getByLabel('Wireframe').uncheck();
    await page.mouse.click(WIDTH / 2, HEIGHT / 2);
    out.vertex = await page.evaluate(() => viewer.found && { ...viewer.found, shown: document.querySelector('.found').innerText });
    await page.screenshot({ path: path.join(asked.pictures, 'question.png') });
    await page.getByLabel('Measure distances').check();
    await page.mouse.click(WIDTH / 2, HEIGHT / 2);
    await page.mouse.click(WIDTH / 2 + 90, HEIGHT / 2 + 20);
    // They are drawn in the next frame.
    await page.waitForFunction(() => document.querySelector('.marks line'), null, { timeout: 10_000 }).catch(() => {});
    out.distance = await page.evaluate(() => viewer.found && { rows: viewer.found.rows, lines: document.querySelectorAll('.marks line').length });
    await page.screenshot({ path: path.join(asked.pictures, 'distance.png') });
    await page.getByLabel('Measure distances').uncheck();
    // Nearer, to the finest level, and still without a hole.
    for (const [number, factor] of [0.35, 0.25].entries()) {
        await page.evaluate(factor => viewer.look({ distance: viewer.eye().distance * factor }), factor);
        const holes = [];
        for (let i = 0; i < 40 && !(await page.evaluate(() => viewer.stats.idle)); i++) {
            holes.push(await page.evaluate(() => viewer.stats.triangles));
            await page.waitForTimeout(50);
        }
        await idle(page);
        out[`near${number}`] = { stats: await stats(page), meanwhile: holes };
        await page.screenshot({ path: path.join(asked.pictures, `near-${number}.png`) });
    }
    out.heard = heard;
    out.address = address;
    await context.close();
    // Narrow, as on a telephone; and touched.
    const small = await opened({ viewport: { width: 360, height: 640 }, hasTouch: true });
    await small.page.goto(address);
    await idle(small.page);
    await small.page.screenshot({ path: path.join(asked.pictures, 'narrow.png') });
    out.narrow = await small.page.evaluate(() => ({ wide: document.documentElement.scrollWidth, open: document.querySelector('.panel').open }));
    await small.page.touchscreen.tap(180, 330);
    out.narrow.touched = await small.page.evaluate(() => !!viewer.found);
    out.narrow.errors = small.heard.errors;
    await small.context.close();
    // Without WebGL 2.
    const none = await opened();
    await none.page.addInitScript(() => { HTMLCanvasElement.prototype.getContext = () => null; });
    await none.page.goto(address);
    out.none = { words: await none.page.textContent('.wrong'), shown: await none.page.isVisible('.wrong'), errors: none.heard.errors };
    await none.context.close();
    out.code = await ended();
}

// The same mesh, encoded.
{
    const { address, ended } = await viewed(asked.packed);
    const { page, heard, context } = await opened();
    await page.goto(address);
    await idle(page);
    const [azimuth, elevation] = asked.directions[0];
    await settled(page, () => page.evaluate(([azimuth, elevation]) => { viewer.set({ colour: '', detail: 100 }); viewer.look({ azimuth, elevation, parallel: true, fit: true }); }, [azimuth, elevation]));
    await canvas(page, 'packed.png');
    out.packed = { stats: await stats(page), errors: heard.errors, name: 'packed.png' };
    await context.close();
    await ended();
}

// 2. A mesh file by itself.
if (asked.mesh) {
    const { address, ended, start, ready } = await viewed(asked.mesh);
    const { page, heard, context } = await opened();
    await page.goto(address);
    await page.waitForFunction(() => window.viewer && viewer.stats.triangles > 0);
    out.mesh = { ready, picture: performance.now() - start, errors: heard.errors };
    await context.close();
    await ended();
}

// 3. Reports, as files.
out.pages = [];
for (const [number, file] of asked.pages.entries()) {
    const { page, heard, context } = await opened();
    await page.goto(`file://${file}`);
    await idle(page);
    await page.screenshot({ path: path.join(asked.pictures, `page-${number}.png`) });
    await page.screenshot({ path: path.join(asked.pictures, `page-${number}-all.png`), fullPage: true });
    await page.locator('.viewer').scrollIntoViewIfNeeded();
    out.pages.push({ file, heard, stats: await stats(page), images: await page.evaluate(() => [...document.images].map(image => image.naturalWidth)), bars: await page.locator('rect, .bars i').count() });
    await context.close();
}

// 4. Other people's readers, on a page of this program's own server.
const TYPES = { '.js': 'text/javascript', '.json': 'application/json', '.glb': 'model/gltf-binary', '.wasm': 'application/wasm', '.css': 'text/css' };
const server = http.createServer((request, answer) => {
    const url = decodeURIComponent(new URL(request.url, 'http://localhost').pathname);
    const page = { '/three': '<canvas id="c"></canvas><script src="/built/three.js"></script>', '/cesium': '<style>#c, #c div:first-child, #c canvas { width: 900px; height: 700px; }</style><div id="c"></div><script>window.CESIUM_BASE_URL="/Cesium/"</script><script src="/Cesium/Cesium.js"></script><script src="/built/cesium.js"></script>' }[url];
    if (page) { answer.setHeader('content-type', 'text/html'); answer.end(`<!doctype html><link rel="icon" href="data:,"><body style="margin:0">${page}`); return; }
    const [root, rest] = [['/tiles/', path.dirname(asked.tree)], ['/built/', asked.built], ['/Cesium/', asked.cesium]].find(([start]) => url.startsWith(start)) || [];
    const file = root && path.join(rest, url.slice(root.length));
    if (!file || !fs.existsSync(file)) { answer.statusCode = 404; answer.end(); return; }
    answer.setHeader('content-type', TYPES[path.extname(file)] || 'application/octet-stream');
    fs.createReadStream(file).pipe(answer);
});
await new Promise(done => server.listen(0, '127.0.0.1', done));
const base = `http://127.0.0.1:${server.address().port}`;
for (const reader of ['three', 'cesium']) {
    const { page, heard, context } = await opened();
    await page.goto(`${base}/${reader}`);
    const found = [];
    for (const [number, closeness] of asked.closeness.entries()) {
        found.push(await page.evaluate(closeness => window.look('/tiles/tileset.json', closeness), closeness));
        await page.screenshot({ path: path.join(asked.pictures, `${reader}-${number}.png`) });
    }
    out[reader] = { ...(await page.evaluate(() => window.loaded())), found, heard };
    await context.close();
}
server.close();
await browser.close();
console.log(JSON.stringify(out));
