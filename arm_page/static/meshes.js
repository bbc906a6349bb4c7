// Meshes of the links, in place of their capsules.

import { ColladaLoader, Group, Mesh, OBJLoader, STLLoader } from "./vendor/three.js";
import { bytesOf } from "./server.js";

/** Loads the meshes of a scene into the links of figures, in the material of each; how many could be shown. */
export async function loadMeshes(meshes, figures, fixed, draw) {
  let shown = 0;
  for (const [number, mesh] of meshes.entries()) {
    const data = await bytesOf(`/api/mesh/${number}`);
    const shape = data && parsed(mesh.kind, data);
    if (!shape) continue;
    for (const figure of figures) {
      const place = fixed(mesh.pose), copy = shape.clone();
      copy.traverse((part) => part.isMesh && (part.material = figure.material));
      copy.scale.multiply({ x: mesh.scale[0], y: mesh.scale[1], z: mesh.scale[2] });
      place.add(copy);
      figure.hideCapsules(mesh.link);
      figure.links[mesh.link].add(place);
    }
    shown += 1;
    draw();
  }
  return shown;
}

function parsed(kind, data) {
  try {
    if (kind === ".stl") return new Group().add(new Mesh(new STLLoader().parse(data)));
    const text = new TextDecoder().decode(data);
    return kind === ".obj" ? new OBJLoader().parse(text) : new ColladaLoader().parse(text, "/").scene;
  } catch {
    return null; // a file that is no mesh: the capsules stay
  }
}
