// A tileset in CesiumJS, without globe, sky, or anything from elsewhere.
const { Cesium } = window;
const widget = new Cesium.CesiumWidget('c', {
    baseLayer: false, globe: false, skyBox: false, skyAtmosphere: false, creditContainer: document.createElement('div'), contextOptions: { webgl: { preserveDrawingBuffer: true } },
});
const { scene } = widget;
scene.backgroundColor = Cesium.Color.WHITE;
const triangles = {}, errors = [];
let tileset, swept = false;
scene.renderError.addEventListener((_, error) => errors.push(String(error)));

const settled = async () => {
    let quiet = 0;
    while (quiet < 4) {
        await new Promise(requestAnimationFrame);
        quiet = tileset.tilesLoaded ? quiet + 1 : 0;
    }
};

window.look = async (url, closeness) => {
    if (!tileset) {
        tileset = await Cesium.Cesium3DTileset.fromUrl(url, { cacheBytes: 4e9, preloadFlightDestinations: false });
        tileset.tileLoad.addEventListener(tile => { triangles[tile.content.url.split('/').pop().split('?')[0]] = tile.content.trianglesLength; });
        tileset.tileFailed.addEventListener(({ url, message }) => errors.push(`${url}: ${message}`));
        scene.primitives.add(tileset);
    }
    const sphere = tileset.boundingSphere, far = sphere.radius * closeness;
    // About the tileset's own axes: east and north of where it lies, if that is on the Earth.
    const frame = tileset.root.computedTransform;
    const way = Cesium.Cartesian3.normalize(new Cesium.Cartesian3(.5, -.75, .55), new Cesium.Cartesian3());
    const turned = Cesium.Matrix4.multiplyByPointAsVector(frame, way, new Cesium.Cartesian3());
    const position = Cesium.Cartesian3.add(sphere.center, Cesium.Cartesian3.multiplyByScalar(turned, far, new Cesium.Cartesian3()), new Cesium.Cartesian3());
    const up = Cesium.Matrix4.multiplyByPointAsVector(frame, Cesium.Cartesian3.UNIT_Z, new Cesium.Cartesian3());
    // It is made for globes: a thing of a few centimetres would lie before the nearest that is drawn.
    scene.camera.frustum.near = sphere.radius / 1000;
    scene.camera.lookAtTransform(Cesium.Matrix4.IDENTITY);
    scene.camera.setView({ destination: position, orientation: { direction: Cesium.Cartesian3.negate(turned, new Cesium.Cartesian3()), up } });
    // Once, from afar, where all of it is in view: every level comes.
    for (const error of swept ? [] : [1e6, 64, 16, 4, 1, .01]) {
        tileset.maximumScreenSpaceError = error;
        await settled();
    }
    swept = true;
    tileset.maximumScreenSpaceError = 2;
    await settled();
    return { drawn: tileset.statistics.numberOfTrianglesSelected };
};
window.loaded = () => ({ triangles, errors, version: Cesium.VERSION });
