//! Bytes: buffers and the views on them, loaded only when a mesh needs them.
//!
//! A buffer is the binary chunk, a data URI or a file among the [`Resources`]; a view is a range of a buffer, or is
//! decompressed from one. All of them together stay within the byte limit.

use std::borrow::Cow;
use std::cell::{Cell, OnceCell};

use base64::engine::DecodePaddingMode;
use base64::engine::general_purpose::{GeneralPurpose, GeneralPurposeConfig};
use base64::{DecodeError, Engine};

use super::document::{Document, lookup};
use super::meshopt;
use crate::error::{Error, Quoted, Result};
use crate::mesh::allowance::Allowance;
use crate::mesh::resources::check_relative;
use crate::mesh::{Limits, Resources};

/// The buffers of a document.
pub struct Buffers<'a> {
    document: &'a Document,
    binary: Option<&'a [u8]>,
    resources: &'a dyn Resources,
    max_bytes: u64,
    left: Cell<u64>,
    /// Bytes of the file and of the files it refers to, as far as they were read.
    sent: Cell<u64>,
    /// Bytes of all views that were decompressed.
    unpacked: Cell<u64>,
    buffers: Vec<OnceCell<Cow<'a, [u8]>>>,
    decompressed: Vec<OnceCell<Vec<u8>>>,
}

/// A range of bytes that accessors look into.
#[derive(Debug, Clone, Copy)]
pub struct View<'b> {
    /// The bytes.
    pub bytes: &'b [u8],
    /// Distance between elements, where it is not their size.
    pub stride: Option<usize>,
}

impl<'a> Buffers<'a> {
    /// The buffers of `document`, of whose file `file_bytes` bytes are already accounted for.
    pub fn new(
        document: &'a Document,
        binary: Option<&'a [u8]>,
        resources: &'a dyn Resources,
        limits: &Limits,
        file_bytes: u64,
    ) -> Self {
        Self {
            document,
            binary,
            resources,
            max_bytes: limits.max_bytes,
            left: Cell::new(limits.max_bytes.saturating_sub(file_bytes)),
            sent: Cell::new(file_bytes),
            unpacked: Cell::new(0),
            buffers: document.buffers.iter().map(|_| OnceCell::new()).collect(),
            decompressed: document.buffer_views.iter().map(|_| OnceCell::new()).collect(),
        }
    }

    /// The document that the buffers belong to.
    pub fn document(&self) -> &'a Document {
        self.document
    }

    /// Bytes that the file and the buffers read so far have together.
    pub fn bytes(&self) -> u64 {
        self.max_bytes - self.left.get()
    }

    /// What the bytes that were sent may become, those read so far.
    pub fn allowance(&self) -> Allowance {
        Allowance::new(self.sent.get())
    }

    /// The bytes of buffer view `index`, which `whence` refers to.
    pub fn view(&self, index: usize, whence: &str) -> Result<View<'_>> {
        let view = lookup(&self.document.buffer_views, index, "bufferView", whence)?;
        let me = format!("bufferView {index}");
        if let Some(compressed) = meshopt::Compressed::of(view, &me)? {
            let bytes = match self.decompressed[index].get() {
                Some(bytes) => bytes,
                None => {
                    let encoded =
                        self.range(compressed.buffer as usize, compressed.byte_offset, compressed.byte_length, &me)?;
                    let size = compressed.check(encoded, &me)?;
                    self.unpacked.set(self.unpacked.get().saturating_add(size));
                    self.allowance().check_decompressed(self.unpacked.get())?;
                    self.take(size, &me)?;
                    let bytes = compressed.decode(encoded, &me)?;
                    self.decompressed[index].get_or_init(|| bytes)
                }
            };
            return Ok(View { bytes, stride: Some(compressed.byte_stride) });
        }
        let offset = view.byte_offset.map_or(0, |offset| offset.0);
        Ok(View {
            bytes: self.range(view.buffer.value(), offset, view.byte_length.0, &me)?,
            stride: view.byte_stride.map(|stride| stride.0).filter(|&stride| stride > 0),
        })
    }

    /// `length` bytes at `offset` of buffer `index`.
    fn range(&self, index: usize, offset: u64, length: u64, whence: &str) -> Result<&[u8]> {
        let declared = lookup(&self.document.buffers, index, "buffer", whence)?.byte_length.0;
        // what the document contradicts by itself needs no loading
        let end = offset.checked_add(length).filter(|&end| end <= declared);
        let Some(end) = end else {
            return Err(Error::mesh(format_args!(
                "{whence} ends beyond buffer {index}, which has {declared} bytes: offset {offset}, length {length}"
            )));
        };
        let bytes = self.buffer(index, declared)?;
        // `buffer` has checked that there are as many bytes as declared
        Ok(bytes.get(offset as usize..end as usize).unwrap_or_default())
    }

    /// The bytes of buffer `index`, at least as many as declared.
    fn buffer(&self, index: usize, declared: u64) -> Result<&[u8]> {
        if let Some(bytes) = self.buffers[index].get() {
            return Ok(bytes);
        }
        let bytes = self.load(index)?;
        if (bytes.len() as u64) < declared {
            return Err(Error::mesh(format_args!(
                "buffer {index} is truncated: it declares {declared} bytes, it has {}",
                bytes.len()
            )));
        }
        Ok(self.buffers[index].get_or_init(|| bytes))
    }

    fn load(&self, index: usize) -> Result<Cow<'a, [u8]>> {
        let me = format!("buffer {index}");
        let Some(uri) = self.document.buffers[index].uri.as_deref() else {
            return match self.binary {
                Some(binary) if index == 0 => Ok(Cow::Borrowed(binary)),
                _ => Err(Error::mesh(format_args!("{me} has no uri, and only buffer 0 of a GLB file may have none"))),
            };
        };
        let scheme = uri.get(..5).unwrap_or_default();
        let bytes = if scheme.eq_ignore_ascii_case("data:") {
            let bytes =
                decode_data_uri(&uri[5..]).map_err(|what| Error::mesh(format_args!("the data URI of {me} {what}")))?;
            self.take(bytes.len() as u64, &me)?;
            bytes
        } else {
            // before and after: neither a hidden nor an open scheme, slash or `..` gets through
            let named = |error: Error| Error::new(error.kind, format_args!("{me}: {error}"));
            check_relative(uri).map_err(named)?;
            let path = percent_encoding::percent_decode_str(uri).decode_utf8().map_err(|_| {
                Error::mesh(format_args!("the uri of {me} is not UTF-8 when percent-decoded: {}", Quoted(uri)))
            })?;
            check_relative(&path).map_err(named)?;
            let bytes = self.resources.load(&path, self.left.get()).map_err(named)?;
            self.take(bytes.len() as u64, &me)?;
            self.sent.set(self.sent.get().saturating_add(bytes.len() as u64));
            bytes
        };
        Ok(Cow::Owned(bytes))
    }

    /// Accounts for `bytes` more bytes.
    fn take(&self, bytes: u64, whence: &str) -> Result<()> {
        let Some(left) = self.left.get().checked_sub(bytes) else {
            return Err(Error::too_large(format_args!(
                "the mesh and its buffers have more bytes than the limit of {} (raise it with --max-upload-bytes); \
                 {whence} adds {bytes}",
                self.max_bytes
            )));
        };
        self.left.set(left);
        Ok(())
    }
}

/// Decodes what follows `data:`; otherwise what is wrong with it.
fn decode_data_uri(uri: &str) -> Result<Vec<u8>, String> {
    const BASE64: GeneralPurpose = GeneralPurpose::new(
        &base64::alphabet::STANDARD,
        GeneralPurposeConfig::new()
            .with_decode_padding_mode(DecodePaddingMode::Indifferent)
            .with_decode_allow_trailing_bits(true),
    );
    let (media_type, data) = uri.split_once(',').ok_or("has no data: a comma must stand before them")?;
    let data: Cow<'_, [u8]> = percent_encoding::percent_decode_str(data).into();
    let is_base64 = media_type.rsplit(';').next().is_some_and(|last| last.trim().eq_ignore_ascii_case("base64"));
    if !is_base64 {
        return Ok(data.into_owned());
    }
    BASE64.decode(data.as_ref()).map_err(|error| match error {
        DecodeError::InvalidByte(at, byte) | DecodeError::InvalidLastSymbol { offset: at, symbol: byte, .. } => {
            format!("is not base64, or damaged: at character {at} of its data: {:?}", char::from(byte))
        }
        DecodeError::InvalidLength(length) => {
            format!("is not base64, or damaged: its data end in the middle of a byte, after characters: {length}")
        }
        DecodeError::InvalidPadding => "is not base64, or damaged: its data have the wrong padding".to_owned(),
    })
}
