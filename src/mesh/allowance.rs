//! What a file may become, in proportion to the bytes that were sent: a small file takes little memory.
//!
//! A format can say much in few bytes: one mesh at many places, zeros without bytes, compressed zeros, one name for
//! very many faces. Each of these is counted before anything is built. The limit is a multiple of the bytes sent, and a
//! constant so that small scenes pass. A file that is refused passes when its placements are written out.
//!
//! At the peak of a job a face takes some 200 bytes (250 where none shares a vertex, 650 in a hierarchy) and a part
//! some 350 with its lines in the report. So a file takes at most some 700 bytes a byte (1,500 in a hierarchy), most of
//! it for placed faces, and 150 MB (350).

use super::Part;
use crate::error::{Error, Result, names};

/// Faces that a file may have however small it is,
const FREE_FACES: u64 = 1 << 19;
/// and for each of its bytes, unless a setting says otherwise. The bytes of a strip's index make one face; more come
/// from placing a mesh again.
pub(super) const FACES_PER_BYTE: u64 = 2;

/// Parts that a file may have however small it is,
const FREE_PARTS: u64 = 1 << 16;
/// and bytes that it must have for each further one. An instance has 12 bytes as a rule, a node 11.
const BYTES_PER_PART: u64 = 2;

/// Decompressed bytes that a file may have however small it is,
const FREE_DECOMPRESSED: u64 = 4 << 20;
/// and for each of its bytes. Compressed meshes have 2 to 10, flat ones up to 100.
const DECOMPRESSED_PER_BYTE: u64 = 128;

/// Bytes of names that all parts together may have however small the file is,
const FREE_NAMES: u64 = 1 << 20;
/// and for each of its bytes.
const NAMES_PER_BYTE: u64 = 8;

/// Vertices that no face uses and that are kept however small the file is,
const FREE_VERTICES: u64 = 1 << 16;
/// and bytes that it must have for each further one: enough for every vertex of a file of floats to be there once.
const BYTES_PER_VERTEX: u64 = 12;

/// JSON objects that a document may have however short it is,
const FREE_OBJECTS: u64 = 1 << 16;
/// and bytes that it must have for each further one: an object takes some 200 bytes, and says something in 8.
const BYTES_PER_OBJECT: u64 = 8;

/// What a file of some bytes may become.
#[derive(Debug, Clone, Copy)]
pub struct Allowance {
    /// Bytes that were sent: the file and the files it refers to.
    sent: u64,
}

impl Allowance {
    /// For as many bytes as were sent, the file and the files it refers to together.
    pub fn new(sent: u64) -> Self {
        Self { sent }
    }

    /// Refuses more faces than the bytes allow, `a_byte` for each; none: all.
    pub fn check_faces(&self, faces: u64, a_byte: Option<u64>) -> Result<()> {
        let what = match names::are_flags() {
            true => {
                "the mesh places more faces than its bytes allow (raise it with --max-faces-per-byte, or write the \
                 placements out)"
            }
            false => "the mesh places more faces than its bytes allow (write the placements out)",
        };
        self.check(faces, self.most_faces(a_byte), what)
    }

    /// Faces that the bytes allow, `a_byte` for each; none: any number.
    fn most_faces(&self, a_byte: Option<u64>) -> u64 {
        a_byte.map_or(u64::MAX, |a_byte| self.times(a_byte).saturating_add(FREE_FACES))
    }

    /// Refuses more parts than the bytes allow.
    pub fn check_parts(&self, parts: u64) -> Result<()> {
        let most = FREE_PARTS.saturating_add(self.sent / BYTES_PER_PART);
        self.check(parts, most, "the mesh has more parts than its bytes allow (join primitives or placements)")
    }

    /// Refuses more decompressed bytes than the bytes allow.
    pub fn check_decompressed(&self, bytes: u64) -> Result<()> {
        let most = self.times(DECOMPRESSED_PER_BYTE).saturating_add(FREE_DECOMPRESSED);
        self.check(bytes, most, "the mesh decompresses to more bytes than its bytes allow (send it uncompressed)")
    }

    /// Refuses more objects in a JSON text, which the bytes are, than its length allows.
    pub fn check_objects(&self, objects: u64) -> Result<()> {
        let most = FREE_OBJECTS.saturating_add(self.sent / BYTES_PER_OBJECT);
        self.check(objects, most, "the glTF JSON has more objects than its bytes allow (leave out empty ones)")
    }

    /// Vertices that no face uses and that may be kept.
    pub fn spare_vertices(&self) -> u64 {
        FREE_VERTICES.saturating_add(self.sent / BYTES_PER_VERTEX)
    }

    /// Takes the names from the parts behind the last for whose name there is room, and says so.
    ///
    /// Names are shared in memory, but spelled out in the report; they decide nothing, so a mesh is not refused for
    /// them.
    pub fn limit_names(&self, parts: &mut [Part]) -> Option<String> {
        let most = self.times(NAMES_PER_BYTE).saturating_add(FREE_NAMES);
        let mut total = 0u64;
        let mut without = 0u64;
        for part in parts {
            let Some(name) = &part.group else { continue };
            total = total.saturating_add(name.len() as u64);
            if total > most {
                part.group = None;
                without += 1;
            }
        }
        (without > 0).then(|| {
            format!(
                "the names of all parts together are longer than {most} bytes, so the last parts have none: {without}"
            )
        })
    }

    fn times(&self, factor: u64) -> u64 {
        self.sent.saturating_mul(factor)
    }

    fn check(&self, count: u64, most: u64, what: &str) -> Result<()> {
        if count <= most {
            return Ok(());
        }
        Err(Error::too_large(format_args!("{what}; {} bytes may have {most}: {count}", self.sent)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::error::Kind;

    #[test]
    fn more_bytes_allow_more() {
        type Check = fn(&Allowance, u64) -> Result<()>;
        let checks: [(Check, u64, u64); 4] = [
            (|allowance, faces| allowance.check_faces(faces, Some(FACES_PER_BYTE)), 524_288, 524_288 + 2_000),
            (Allowance::check_parts, 65_536, 65_536 + 500),
            (Allowance::check_decompressed, 4_194_304, 4_194_304 + 128_000),
            (Allowance::check_objects, 65_536, 65_536 + 125),
        ];
        for (check, free, thousand) in checks {
            for (sent, most) in [(0, free), (1000, thousand)] {
                let allowance = Allowance::new(sent);
                assert_eq!(check(&allowance, most), Ok(()));
                let error = check(&allowance, most + 1).expect_err("too many");
                assert_eq!(error.kind, Kind::TooLarge);
                let words = format!("; {sent} bytes may have {most}: {}", most + 1);
                assert!(error.message.ends_with(&words), "{error}");
            }
            assert_eq!(check(&Allowance::new(u64::MAX), 1 << 60), Ok(()));
        }
        assert_eq!(Allowance::new(0).check_faces(524_289, None), Ok(()));
        assert!(Allowance::new(1).check_faces(524_288 + 8, Some(7)).is_err());
    }

    #[test]
    fn names_end_where_there_is_no_room() {
        let name = Some("x".repeat(1024).into());
        let mut parts = vec![Part { group: name, ..Part::default() }; 1100];
        assert_eq!(Allowance::new(1 << 20).limit_names(&mut parts), None);
        let warning = Allowance::new(1024).limit_names(&mut parts).expect("too many names");
        assert!(warning.ends_with("none: 68"), "{warning}");
        assert!(parts.iter().enumerate().all(|(at, part)| part.group.is_some() == (at < 1032)));
        assert_eq!(Allowance::new(1024).limit_names(&mut parts), None);
    }
}
