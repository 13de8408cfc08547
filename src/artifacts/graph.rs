//! The graph of neighbouring clusters.

use std::io::{self, Write};

use serde::Serialize;
use utoipa::ToSchema;

use super::clusters::{COLUMNS, graph, number};
use super::{Artifact, Content, Encoding, Flag, Form, Need, schema_of};
use crate::complex::graph::Edge;
use crate::complex::{Cluster, Graph};
use crate::error::Result;
use crate::export::npz::{self, Array};

/// The graph of neighbouring clusters.
pub static GRAPH: Artifact = Artifact {
    name: "graph",
    about: "Which clusters are neighbours, and the length of the curves between them.",
    needs: &[Need::Labels, Need::Mesh],
    forms: &[
        Form {
            file: "graph.json",
            media_type: "application/json",
            is_stored: false,
            schema: Some(schema_of::<NodeLink>),
            encode: json,
        },
        Form { file: "graph.npz", media_type: "application/x-npz", is_stored: false, schema: None, encode: matrix },
        Form {
            file: "graph.graphml",
            media_type: "application/graphml+xml",
            is_stored: false,
            schema: None,
            encode: graphml,
        },
    ],
    choices: &[],
    flags: &[Flag {
        name: "--clusters-graph",
        value: "OUT",
        help: "Where to write the graph of neighbouring clusters: OUT.json (as networkx reads it), OUT.npz (scipy's \
               sparse matrix of lengths) or OUT.graphml, or - for JSON on standard output",
    }],
    is_served: true,
};

/// A graph as networkx reads it: `networkx.node_link_graph`.
#[derive(Debug, Serialize, ToSchema)]
pub struct NodeLink {
    /// Version of this format: 1.
    tesserae: u32,
    /// Whether edges have a direction: false.
    directed: bool,
    /// Whether there may be several edges between two nodes: false.
    multigraph: bool,
    /// The clusters.
    nodes: Vec<Node>,
    /// Pairs of clusters that a curve separates.
    edges: Vec<Edge>,
}

/// A cluster as a node.
#[derive(Debug, Serialize, ToSchema)]
#[schema(as = GraphNode)]
struct Node {
    /// The number of the cluster.
    id: u32,
    /// Its row of the cluster table.
    #[serde(flatten)]
    cluster: Cluster,
}

fn json<'a>(content: &Content<'a>) -> Result<Encoding<'a>> {
    let Graph { nodes, edges } = graph(content)?;
    let nodes = nodes.into_iter().map(|cluster| Node { id: cluster.cluster, cluster }).collect();
    let graph = NodeLink { tesserae: 1, directed: false, multigraph: false, nodes, edges };
    Ok(Box::new(move |out| {
        serde_json::to_writer(&mut *out, &graph)?;
        out.write_all(b"\n")
    }))
}

/// What `scipy.sparse.load_npz` reads: a symmetric matrix of lengths, rows compressed.
fn matrix<'a>(content: &Content<'a>) -> Result<Encoding<'a>> {
    let Graph { nodes, edges } = graph(content)?;
    let mut entries: Vec<(u32, u32, f64)> = Vec::with_capacity(2 * edges.len());
    for edge in &edges {
        entries.push((edge.source, edge.target, edge.length));
        entries.push((edge.target, edge.source, edge.length));
    }
    entries.sort_unstable_by_key(|&(row, column, _)| (row, column));
    let mut begin = vec![0; nodes.len() + 1];
    entries.iter().for_each(|&(row, _, _)| begin[row as usize + 1] += 1);
    for row in 0..nodes.len() {
        begin[row + 1] += begin[row];
    }
    let columns: Vec<i32> = entries.iter().map(|&(_, column, _)| column as i32).collect();
    let lengths: Vec<f64> = entries.iter().map(|&(_, _, length)| length).collect();
    let size = nodes.len() as i64;
    let arrays = [
        ("indices", Array::i32(&[columns.len()], &columns)),
        ("indptr", Array::i32(&[begin.len()], &begin)),
        ("format", Array::bytes(b"csr")),
        ("shape", Array::i64(&[2], &[size, size])),
        ("data", Array::f64(&[lengths.len()], &lengths)),
    ];
    Ok(Box::new(move |out| npz::write(out, &arrays)))
}

fn graphml<'a>(content: &Content<'a>) -> Result<Encoding<'a>> {
    let graph = graph(content)?;
    Ok(Box::new(move |out| write_graphml(out, &graph)))
}

fn write_graphml(out: &mut dyn Write, graph: &Graph) -> io::Result<()> {
    writeln!(out, "<?xml version=\"1.0\" encoding=\"UTF-8\"?>")?;
    writeln!(out, "<graphml xmlns=\"http://graphml.graphdrawing.org/xmlns\">")?;
    let mut key = |of: &str, name: &str, kind: &str| {
        writeln!(out, "<key id=\"{name}\" for=\"{of}\" attr.name=\"{name}\" attr.type=\"{kind}\"/>")
    };
    COLUMNS.iter().try_for_each(|column| key("node", column.name, column.kind))?;
    key("edge", "length", "double")?;
    key("edge", "arcs", "long")?;
    writeln!(out, "<graph id=\"clusters\" edgedefault=\"undirected\">")?;
    for node in &graph.nodes {
        write!(out, "<node id=\"{}\">", node.cluster)?;
        for column in COLUMNS {
            if let Some(value) = (column.value)(node) {
                write!(out, "<data key=\"{}\">{value}</data>", column.name)?;
            }
        }
        writeln!(out, "</node>")?;
    }
    for Edge { source, target, length, arcs } in &graph.edges {
        write!(out, "<edge source=\"{source}\" target=\"{target}\">")?;
        if let Some(length) = number(*length) {
            write!(out, "<data key=\"length\">{length}</data>")?;
        }
        writeln!(out, "<data key=\"arcs\">{arcs}</data></edge>")?;
    }
    writeln!(out, "</graph>\n</graphml>")
}

#[cfg(test)]
mod tests {
    use super::super::tests::written;
    use super::*;
    use serde_json::Value;

    #[test]
    fn all_forms_have_the_same_edges() {
        let [json, npz, graphml] = [0, 1, 2].map(|form| written(&GRAPH, form));
        let raw = String::from_utf8(json).expect("text");
        let json: Value = serde_json::from_str(&raw).expect("JSON");
        let (nodes, edges) = (json["nodes"].as_array().expect("nodes"), json["edges"].as_array().expect("edges"));
        assert!(nodes.len() == 5 && edges.len() > 3, "{json}");
        assert!(nodes.iter().zip(0..).all(|(node, id)| node["id"] == id && node["faces"].as_u64() > Some(0)));
        let text = String::from_utf8(graphml).expect("text");
        assert_eq!(text.matches("<node ").count(), nodes.len());
        // stored, so that the arrays are there as they are
        let holds = |bytes: &[u8]| npz.windows(bytes.len()).filter(|window| *window == bytes).count();
        for line in text.lines().filter_map(|line| line.strip_prefix("<edge source=\"")) {
            let words: Vec<&str> = line.split(['"', '<', '>']).collect();
            let (source, target, length, arcs) = (words[0], words[2], words[8], words[14]);
            let edge = format!("{{\"source\":{source},\"target\":{target},\"length\":{length},\"arcs\":{arcs}}}");
            assert!(raw.contains(&edge), "{line} {edge}");
            assert!(holds(&length.parse::<f64>().expect("a length").to_le_bytes()) >= 2);
        }
        assert_eq!(text.matches("<edge ").count(), edges.len());
        assert_eq!((holds(b"indptr.npy"), holds(b"'|S3'")), (2, 1));
    }
}
