// node read_glb.mjs THREE FILE TIMES: what three's GLTFLoader makes of a file, as JSON. THREE is three's folder.
import { readFile } from "node:fs/promises";
import { pathToFileURL } from "node:url";

const [folder, file, times] = process.argv.slice(2);
const three = await import(pathToFileURL(`${folder}/build/three.module.js`));
const { GLTFLoader } = await import(pathToFileURL(`${folder}/examples/jsm/loaders/GLTFLoader.js`));
const bytes = await readFile(file);
const loaded = await new GLTFLoader().parseAsync(bytes.buffer.slice(bytes.byteOffset, bytes.byteOffset + bytes.length), "");
const [clip] = loaded.animations;
const camera = loaded.cameras[0];
const mixer = new three.AnimationMixer(loaded.scene);
const action = mixer.clipAction(clip);
action.setLoop(three.LoopOnce);
action.clampWhenFinished = true;
action.play();
const seen = JSON.parse(times).map((t) => {
  mixer.setTime(t);
  loaded.scene.updateMatrixWorld(true);
  const up = new three.Vector3(0, 1, 0).transformDirection(camera.matrixWorld);
  return {
    position: camera.getWorldPosition(new three.Vector3()).toArray(),
    ahead: camera.getWorldDirection(new three.Vector3()).toArray(),
    up: up.toArray(),
    people: loaded.scene.children.filter((one) => one.name.startsWith("person")).map((one) => one.position.toArray()),
  };
});
const meshes = [];
loaded.scene.traverse((one) => {
  if (one.isMesh) {
    const box = new three.Box3().setFromObject(one);
    meshes.push({ name: one.userData.name ?? one.name, low: box.min.toArray(), high: box.max.toArray() });
  }
});
console.log(JSON.stringify({ duration: clip.duration, fov: camera.fov, aspect: camera.aspect, seen, meshes }));
