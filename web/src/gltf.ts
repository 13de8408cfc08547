// glTF and GLB files as three.js's loader may read them: reduced to geometry, with every buffer a blob. So a file
// cannot make the page request an address, and no picture is decoded that is not shown.

interface Buffer {
  uri?: string;
}

/** What is left of a file; the loader checks the rest. */
interface Document {
  buffers?: Buffer[];
  meshes?: { primitives?: { material?: unknown; targets?: unknown }[]; weights?: unknown }[];
  nodes?: { skin?: unknown; camera?: unknown; weights?: unknown; extensions?: Record<string, unknown> }[];
  extensions?: unknown;
  extensionsRequired?: string[];
  [key: string]: unknown;
}

const NOT_DRAWN = ["images", "textures", "samplers", "materials", "animations", "skins", "cameras", "extensions"];

/** The bytes `glTF`. */
const MAGIC = 0x46546c67;

/** The document, and the addresses of its buffers: the caller revokes them. */
export async function geometry(files: File[]): Promise<{ text: string; addresses: string[] }> {
  const [file, ...others] = files;
  if (!file) throw new Error("there is no file");
  const { document, binary } = await open(file);
  if (document.extensionsRequired?.some((name) => /compression/.test(name))) throw new Error("it is compressed");
  for (const key of NOT_DRAWN) delete document[key];
  for (const node of document.nodes ?? []) {
    const instancing = node.extensions?.["EXT_mesh_gpu_instancing"];
    for (const key of ["skin", "camera", "weights", "extensions"] as const) delete node[key];
    if (instancing !== undefined) node.extensions = { EXT_mesh_gpu_instancing: instancing };
  }
  for (const mesh of document.meshes ?? []) {
    delete mesh.weights;
    for (const primitive of mesh.primitives ?? []) {
      delete primitive.material;
      delete primitive.targets;
    }
  }
  const addresses: string[] = [];
  for (const buffer of document.buffers ?? []) {
    addresses.push(URL.createObjectURL(content(buffer, others, binary)));
    buffer.uri = addresses.at(-1) ?? "";
  }
  return { text: JSON.stringify(document), addresses };
}

async function open(file: File): Promise<{ document: Document; binary: Blob | null }> {
  const head = new DataView(await file.slice(0, 20).arrayBuffer());
  if (head.byteLength < 20 || head.getUint32(0, true) !== MAGIC) {
    return { document: JSON.parse(await file.text()) as Document, binary: null };
  }
  const end = 20 + head.getUint32(12, true);
  const document = JSON.parse(await file.slice(20, end).text()) as Document;
  return { document, binary: file.slice(end + 8) };
}

function content({ uri }: Buffer, files: File[], binary: Blob | null): Blob {
  if (uri === undefined) {
    if (binary) return binary;
    throw new Error("a buffer has no content");
  }
  const data = /^data:[^,]*?(;base64)?,/i.exec(uri);
  if (data) {
    const text = decodeURIComponent(uri.slice(data[0].length));
    return new Blob([Uint8Array.from(data[1] ? atob(text) : text, (c) => c.charCodeAt(0))]);
  }
  const name = decodeURIComponent(uri);
  const file = files.find((file) => file.name === name);
  if (!file) throw new Error(`the buffer ${name} was not chosen with it`);
  return file;
}
