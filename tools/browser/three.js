// A tileset in three.js, by 3d-tiles-renderer: looked at from the distance that `closeness` says, at ever smaller errors, until all tiles have come.
import * as THREE from 'three';
import { TilesRenderer } from '3d-tiles-renderer';

const canvas = document.getElementById('c');
const renderer = new THREE.WebGLRenderer({ canvas, antialias: true, preserveDrawingBuffer: true });
renderer.setSize(900, 700);
renderer.setClearColor(0xffffff);
const scene = new THREE.Scene(), camera = new THREE.PerspectiveCamera(45, 900 / 700, 1, 1e6);
scene.add(new THREE.AmbientLight(0xffffff, 1), new THREE.DirectionalLight(0xffffff, 2));
const triangles = {}, errors = [];
let tiles, swept = false;

const settled = async () => {
    let quiet = 0;
    while (quiet < 4) {
        camera.updateMatrixWorld();
        tiles.setCamera(camera);
        tiles.setResolutionFromRenderer(camera, renderer);
        tiles.update();
        renderer.render(scene, camera);
        await new Promise(requestAnimationFrame);
        const { downloading = 0, parsing = 0, queued = 0, inCache = 0 } = tiles.stats;
        quiet = downloading + parsing + queued === 0 && Object.keys(triangles).length ? quiet + 1 : 0;
    }
};

window.look = async (url, closeness) => {
    if (!tiles) {
        tiles = new TilesRenderer(url);
        tiles.addEventListener('load-model', ({ scene, tile }) => {
            const own = [];
            scene.traverse(object => { if (object.isMesh) own.push(object.geometry.index.count / 3); });
            triangles[tile.content.uri.split('/').pop()] = own;
        });
        tiles.addEventListener('load-error', ({ error, url }) => errors.push(`${url}: ${error}`));
        tiles.lruCache.maxBytesSize = 4e9;
        tiles.lruCache.minBytesSize = 3e9;
        scene.add(tiles.group);
    }
    const sphere = new THREE.Sphere();
    while (!tiles.getBoundingSphere(sphere)) {
        tiles.update();
        await new Promise(done => setTimeout(done, 20));
    }
    const far = sphere.radius * closeness;
    camera.up.set(0, 0, 1);
    camera.position.copy(sphere.center).add(new THREE.Vector3(.5, -.75, .55).normalize().multiplyScalar(far));
    camera.near = far / 100;
    camera.far = far + 3 * sphere.radius;
    camera.updateProjectionMatrix();
    camera.lookAt(sphere.center);
    scene.children[1].position.set(-1, -2, 3);
    // Once, from afar, where all of it is in view: every level comes.
    for (const target of swept ? [] : [1e9, 64, 16, 4, 1, .1, 1e-9]) {
        tiles.errorTarget = target;
        await settled();
    }
    swept = true;
    tiles.errorTarget = 2;
    await settled();
    return { drawn: renderer.info.render.triangles };
};
window.loaded = () => ({ triangles, errors, version: THREE.REVISION });
