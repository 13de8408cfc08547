//! Buffers beyond the largest binding.
//!
//! wgpu binds 2 GiB - 1 at most. A surface with a buffer beyond that has all of its buffers in *pages*: buffers of the
//! same number of items each, a power of two. Its kernels are compiled from the same text as those of other surfaces.
//! A buffer is an array of [`MOST_PAGES`] bindings there, and [`paged`] writes the page, and the place in it, for each
//! index.

use super::buffers::{Buffer, Sizes, Spec};

/// Pages of a buffer at most: with those of 2²⁸ indices, as many neighbours as u32 can number.
pub const MOST_PAGES: usize = 16;

/// What WGSL with pages begins with.
pub const ENABLE: &str = "enable wgpu_binding_array;\n";

/// What an adapter must have for pages.
pub const FEATURES: wgpu::Features = wgpu::Features::BUFFER_BINDING_ARRAY
    .union(wgpu::Features::STORAGE_RESOURCE_BINDING_ARRAY)
    .union(wgpu::Features::SAMPLED_TEXTURE_AND_STORAGE_BUFFER_ARRAY_NON_UNIFORM_INDEXING);

/// The bindings of an adapter.
#[derive(Debug, Clone, Copy)]
pub struct Bindings {
    /// Bytes of a binding at most.
    pub bytes: u64,
    /// Pages of a buffer at most; 1 where there are none.
    pub pages: u64,
}

impl Bindings {
    /// Those of an adapter, for kernels that bind so many buffers.
    pub fn new(features: wgpu::Features, limits: &wgpu::Limits, buffers: usize) -> Self {
        let has_pages = features.contains(FEATURES)
            && limits.max_binding_array_elements_per_shader_stage as usize >= buffers * MOST_PAGES;
        Self {
            bytes: limits.max_storage_buffer_binding_size.min(limits.max_buffer_size),
            pages: if has_pages { MOST_PAGES as u64 } else { 1 },
        }
    }

    /// Whether each of these buffers fits one binding.
    pub fn hold_whole(&self, buffers: &[Buffer], sizes: &Sizes) -> bool {
        buffers.iter().all(|buffer| buffer.spec().bytes(sizes) <= self.bytes)
    }

    /// Whether each of these buffers fits one binding, or as many pages as there may be.
    pub fn hold(&self, buffers: &[Buffer], sizes: &Sizes) -> bool {
        let pages = |spec: Spec| spec.items(sizes).div_ceil(self.page(&spec, sizes.axes));
        self.hold_whole(buffers, sizes) || buffers.iter().all(|buffer| pages(buffer.spec()) <= self.pages)
    }

    /// Items of a page, for points of so many axes: a power of two.
    pub fn page(&self, spec: &Spec, axes: usize) -> u64 {
        let most = self.bytes.saturating_sub(spec.head as u64) / (spec.stride)(axes) as u64;
        1 << most.checked_ilog2().unwrap_or(0)
    }
}

/// A part of a page: the buffer, the first byte, and their number.
pub(super) type PagePart<'a> = (&'a wgpu::Buffer, u64, u64);

/// The pages of a buffer, or the one buffer.
#[derive(Debug)]
pub(super) struct Pages {
    buffers: Vec<wgpu::Buffer>,
}

impl From<wgpu::Buffer> for Pages {
    fn from(whole: wgpu::Buffer) -> Self {
        Self { buffers: vec![whole] }
    }
}

impl Pages {
    /// All but the last have the same size.
    pub(super) fn new(buffers: Vec<wgpu::Buffer>) -> Self {
        Self { buffers }
    }

    /// The first page, which has what is before the items; of a buffer without pages, all of it.
    pub(super) fn first(&self) -> &wgpu::Buffer {
        &self.buffers[0]
    }

    /// Bytes of all pages.
    pub(super) fn bytes(&self) -> u64 {
        self.buffers.iter().map(wgpu::Buffer::size).sum()
    }

    /// The parts of pages that hold so many bytes from one on. A buffer with a head has these in its first page.
    pub(super) fn parts(&self, first: u64, bytes: u64) -> impl Iterator<Item = PagePart<'_>> {
        let (page, end) = (self.first().size(), first + bytes);
        (0..).step_by(page as usize).zip(&self.buffers).filter_map(move |(begin, buffer)| {
            let (from, to) = (first.max(begin), end.min(begin + page));
            (from < to).then(|| (buffer, from - begin, to - from))
        })
    }

    /// Fills all pages with zeros.
    pub(super) fn clear(&self, encoder: &mut wgpu::CommandEncoder) {
        self.buffers.iter().for_each(|page| encoder.clear_buffer(page, 0, None));
    }

    /// Copies all pages to those of a buffer of the same size.
    pub(super) fn copy_to(&self, other: &Self, encoder: &mut wgpu::CommandEncoder) {
        let pages = self.buffers.iter().zip(&other.buffers);
        pages.for_each(|(from, to)| encoder.copy_buffer_to_buffer(from, 0, to, 0, None));
    }

    /// What a kernel binds: one buffer, or [`MOST_PAGES`]; those beyond the last are not read.
    pub(super) fn bound(&self, is_paged: bool) -> Vec<wgpu::BufferBinding<'_>> {
        let count = if is_paged { MOST_PAGES } else { 1 };
        let page = |at: usize| self.buffers.get(at).unwrap_or(self.first());
        (0..count).map(|at| wgpu::BufferBinding { buffer: page(at), offset: 0, size: None }).collect()
    }
}

/// The declaration of a buffer of this WGSL type, in pages: of its page, and its type.
pub fn declared(spec: &Spec, ty: &str) -> (String, String) {
    match spec.member {
        Some(_) => (String::new(), format!("binding_array<{ty}, {MOST_PAGES}>")),
        None => (
            format!("struct {}_page {{\n    items: {ty},\n}}\n", spec.name),
            format!("binding_array<{}_page, {MOST_PAGES}>", spec.name),
        ),
    }
}

/// WGSL in which a buffer has pages of so many items: `faces[at]` becomes `faces[(at) >> 3u].items[(at) & 7u]`. What is
/// before the items is in the first page. An index is written twice, so it must not change anything.
pub fn paged(text: &str, spec: &Spec, page: u64) -> String {
    let mut written = String::with_capacity(text.len());
    let mut rest = text;
    while let Some(at) = rest.find(spec.name) {
        let (before, name) = rest.split_at(at);
        let after = &name[spec.name.len()..];
        let is_part = |sign: char| sign.is_alphanumeric() || sign == '_' || sign == '.';
        let is_name = !before.ends_with(is_part);
        written.push_str(before);
        written.push_str(spec.name);
        rest = after;
        if !is_name {
            continue;
        }
        let member = spec.member.unwrap_or("items");
        let items = match spec.member {
            Some(member) => after.strip_prefix('.').and_then(|after| after.strip_prefix(member)),
            None => Some(after),
        };
        if let Some(index) = items.and_then(|items| items.strip_prefix('[')) {
            let end = closing(index);
            let place = paged(&index[..end], spec, page);
            let (bits, mask) = (page.ilog2(), page - 1);
            written.push_str(&format!("[({place}) >> {bits}u].{member}[({place}) & {mask}u]"));
            rest = index[end..].strip_prefix(']').unwrap_or("");
        } else if spec.member.is_some() && after.starts_with('.') {
            written.push_str("[0u]");
        }
    }
    written + rest
}

/// The place of the bracket that closes one before the text, or its end.
fn closing(text: &str) -> usize {
    let mut open = 1;
    let is_closing = |&(_, sign): &(usize, char)| {
        open += i32::from(sign == '[') - i32::from(sign == ']');
        open == 0
    };
    text.char_indices().find(is_closing).map_or(text.len(), |(at, _)| at)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn indices_become_a_page_and_a_place() {
        let text = "labels[a] = clusters[labels[b + c[2]]].labels[3] + my_labels[d]; labels";
        assert_eq!(
            paged(text, &Buffer::Labels.spec(), 8),
            "labels[(a) >> 3u].items[(a) & 7u] = clusters[labels[(b + c[2]) >> 3u].items[(b + c[2]) & 7u]].labels[3] \
             + my_labels[d]; labels"
        );
        assert_eq!(
            paged("boundary_list.entries[a] + boundary_list.lengths[1]", &Buffer::BoundaryList.spec(), 4),
            "boundary_list[(a) >> 2u].entries[(a) & 3u] + boundary_list[0u].lengths[1]"
        );
        assert_eq!(paged("pieces[pieces[a]]", &Buffer::Pieces.spec(), 2).matches(">> 1u").count(), 3);
    }

    #[test]
    fn a_page_has_as_many_items_as_a_binding_holds_rounded_down_to_a_power_of_two() {
        let limits = wgpu::Limits {
            max_storage_buffer_binding_size: (1 << 31) - 1,
            max_buffer_size: u64::MAX,
            max_binding_array_elements_per_shader_stage: 1000,
            ..wgpu::Limits::default()
        };
        let bindings = Bindings::new(FEATURES, &limits, 11);
        let page = |buffer: Buffer| bindings.page(&buffer.spec(), 3);
        assert_eq!([Buffer::Faces, Buffer::Neighbours, Buffer::BoundaryList].map(page), [1 << 26, 1 << 28, 1 << 28]);
        // buffers of one memory have pages of the same bytes
        assert_eq!(page(Buffer::Pieces) * 4, page(Buffer::FaceBids) * 8);
        let holds = |faces| bindings.hold(Buffer::ALL, &Sizes::of(3, faces, faces / 100));
        assert!(holds(1_000_000_000) && holds((1 << 30) - 1) && !holds(1 << 30));
        assert_eq!(Bindings::new(FEATURES, &limits, 1000).pages, 1);
        assert_eq!(Bindings::new(wgpu::Features::empty(), &limits, 11).pages, 1);
    }
}
