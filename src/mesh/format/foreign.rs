//! Files of other kinds that are taken for meshes: recognised by their first bytes, so that a message can say what they
//! are and what to do with them.

/// A kind of file that is not read.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Foreign {
    /// What it is, with its article.
    pub name: &'static str,
    /// What to do with it.
    pub advice: &'static str,
}

const CONVERT: &str = "convert it to OBJ or glTF 2.0, for example with Blender or MeshLab";
const MESH_IT: &str = "it holds no polygon mesh; mesh it in a CAD program and export OBJ or glTF 2.0";
const UNPACK: &str = "unpack it first";
const IMAGE: &str = "of images PNG and JPEG are read, and clustered by pixels; convert it";
const NO_MESH: &str = "it holds no mesh; send the file of the mesh itself";

/// First bytes, name, advice. Longer ones come before those that they begin with.
const KNOWN: [(&[u8], &str, &str); 45] = [
    (b"\x1f\x8b", "a gzip archive", UNPACK),
    (b"\x28\xb5\x2f\xfd", "a Zstandard archive", UNPACK),
    (b"BZh", "a bzip2 archive", UNPACK),
    (b"\xfd7zXZ", "an xz archive", UNPACK),
    (b"7z\xbc\xaf\x27\x1c", "a 7z archive", UNPACK),
    (b"Rar!", "a RAR archive", UNPACK),
    (b"Kaydara FBX", "an FBX file", CONVERT),
    (b"; FBX", "an FBX file", CONVERT),
    (b"BLENDER", "a Blender file", "open it in Blender and export glTF 2.0 or OBJ"),
    (b"MM\x00\x2a", "a TIFF image", IMAGE),
    (b"II\x2a\x00", "a TIFF image", IMAGE),
    (b"# vtk DataFile", "a VTK file", CONVERT),
    (b"#VRML V", "a VRML file", CONVERT),
    (b"#X3D V", "an X3D file", CONVERT),
    (b"#Inventor V", "an Inventor file", CONVERT),
    (b"#usda", "a USD file", CONVERT),
    (b"PXR-USDC", "a USD file", CONVERT),
    (b"# .PCD", "a point cloud (PCD)", "points have no faces; make a mesh of them first"),
    (b".PCD", "a point cloud (PCD)", "points have no faces; make a mesh of them first"),
    (b"LASF", "a point cloud (LAS)", "points have no faces; make a mesh of them first"),
    (b"DRACO", "a Draco file", CONVERT),
    (b"Ogawa", "an Alembic file", CONVERT),
    (b"$MeshFormat", "a Gmsh file", CONVERT),
    (b"MeshVersionFormatted", "a Medit file", CONVERT),
    (b"ISO-10303-21", "a STEP file", MESH_IT),
    (b"DBRep_DrawableShape", "an OpenCASCADE file", MESH_IT),
    (b"<COLLADA", "a COLLADA file", CONVERT),
    (b"<X3D", "an X3D file", CONVERT),
    (b"<VTKFile", "a VTK file", CONVERT),
    (b"<amf", "an AMF file", CONVERT),
    (b"<svg", "an SVG image", IMAGE),
    (b"<", "HTML or XML", "check what was downloaded or sent"),
    (b"\x89PNG", "a PNG image", NO_MESH),
    (b"\xff\xd8\xff", "a JPEG image", NO_MESH),
    (b"GIF8", "a GIF image", IMAGE),
    (b"RIFF", "a RIFF file such as a WebP image", IMAGE),
    (b"\xabKTX", "a KTX texture", NO_MESH),
    (b"DDS ", "a DDS texture", NO_MESH),
    (b"%PDF", "a PDF document", NO_MESH),
    (b"\x7fELF", "a program", NO_MESH),
    (b"\x93NUMPY", "a NumPy array", NO_MESH),
    (b"\xff\xfe", "text in UTF-16", "save it as UTF-8"),
    (b"\xfe\xff", "text in UTF-16", "save it as UTF-8"),
    (b"\x89TSR", "a hierarchy made by tesserae", "cut it with tesserae cut"),
    (b"version https://git-lfs", "a pointer of Git LFS, not the file itself", "fetch the file with git lfs pull"),
];

/// The kind of file that begins with these bytes, if it is one of those.
pub fn recognise(head: &[u8]) -> Option<Foreign> {
    if head.starts_with(b"PK\x03\x04") {
        return Some(match contains(head, b"3D/") || contains(head, b"[Content_Types].xml") {
            true => Foreign { name: "a 3MF file", advice: CONVERT },
            false => Foreign { name: "a ZIP archive", advice: UNPACK },
        });
    }
    let head = crate::mesh::without_mark(head);
    let xml = xml_root(head);
    let known = KNOWN.iter().find(|(magic, _, _)| xml.unwrap_or(head).starts_with(magic));
    known.map(|&(_, name, advice)| Foreign { name, advice })
}

/// From the root element of an XML file on.
fn xml_root(head: &[u8]) -> Option<&[u8]> {
    if !head.starts_with(b"<?xml") {
        return None;
    }
    let mut elements = (1..head.len()).filter(|&at| head[at] == b'<' && !matches!(head.get(at + 1), Some(b'!' | b'?')));
    elements.next().map(|at| &head[at..])
}

fn contains(text: &[u8], part: &[u8]) -> bool {
    text.windows(part.len()).any(|window| window == part)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn kinds_of_xml_and_zip_are_told_apart() {
        for (head, name) in [
            (&b"<?xml version=\"1.0\"?>\n<!-- x -->\n<COLLADA xmlns"[..], "a COLLADA file"),
            (b"<?xml version=\"1.0\"?>", "HTML or XML"),
            (b"<html>", "HTML or XML"),
            (b"PK\x03\x04........3D/3dmodel.model", "a 3MF file"),
            (b"PK\x03\x04........scene.usdc", "a ZIP archive"),
        ] {
            assert_eq!(recognise(head).map(|foreign| foreign.name), Some(name));
        }
    }

    #[test]
    fn no_kind_hides_another() {
        for (at, (magic, name, _)) in KNOWN.iter().enumerate() {
            assert_eq!(recognise(magic).map(|foreign| foreign.name), Some(*name));
            assert!(KNOWN[..at].iter().all(|(before, _, _)| !magic.starts_with(before)), "{name}");
        }
    }
}
