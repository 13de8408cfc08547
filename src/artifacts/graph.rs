//! The graph of neighbouring clusters.

use std::io::{self, Write};

use serde::Serialize;
use utoipa::ToSchema;

use super::clusters::{Clusters, number};
use super::{Artifact, Content, Encoding, Flag, Form, Need, schema_of};
use crate::complex::graph::Edge;
use crate::complex::{Cluster, Graph};
use crate::data::{ClusterEdge, PointCluster};
use crate::error::Result;
use crate::export::npz::{self, Array};

/// The graph of neighbouring clusters.
pub static GRAPH: Artifact = Artifact {
    name: "graph",
    about: "Which clusters are neighbours, and the length of the curves between them; of points, the pairs of \
            neighbours.",
    needs: &[Need::Labels, Need::Mesh],
    forms: &[
        Form {
            file: "graph.json",
            media_type: "application/json",
            is_stored: false,
            schema: Some(schema_of::<NodeLink<'_>>),
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
               sparse matrix of lengths, of points of pairs of items) or OUT.graphml, or - for JSON on standard output",
    }],
    is_of_points: true,
    is_served: true,
};

/// A graph as networkx reads it: `networkx.node_link_graph`.
#[derive(Debug, Serialize, ToSchema)]
pub struct NodeLink<'a> {
    /// Version of this format: 1.
    tesserae: u32,
    /// Whether edges have a direction: false.
    directed: bool,
    /// Whether there may be several edges between two nodes: false.
    multigraph: bool,
    /// The clusters.
    nodes: Vec<Node<'a>>,
    /// Pairs of clusters that a curve separates, or that have neighbouring items.
    edges: Edges<'a>,
}

/// A cluster as a node.
#[derive(Debug, Serialize, ToSchema)]
#[schema(as = GraphNode)]
struct Node<'a> {
    /// The number of the cluster.
    id: u32,
    /// Its row of the cluster table.
    #[serde(flatten)]
    cluster: NodeRow<'a>,
}

/// A row of the cluster table, of a mesh or of points.
#[derive(Debug, Serialize, ToSchema)]
#[serde(untagged)]
#[schema(as = GraphNodeRow)]
enum NodeRow<'a> {
    /// Of a mesh.
    Mesh(Box<Cluster>),
    /// Of points.
    Points(&'a PointCluster),
}

/// Pairs of clusters, of a mesh or of points.
#[derive(Debug, Serialize, ToSchema)]
#[serde(untagged)]
#[schema(as = GraphEdges)]
enum Edges<'a> {
    /// Of a mesh.
    Mesh(Vec<Edge>),
    /// Of points.
    Points(&'a [ClusterEdge]),
}

fn json<'a>(content: &Content<'a>) -> Result<Encoding<'a>> {
    let (nodes, edges) = match Clusters::of(content)? {
        Clusters::Mesh(Graph { nodes, edges }) => {
            let node = |cluster: Cluster| Node { id: cluster.cluster, cluster: NodeRow::Mesh(Box::new(cluster)) };
            (nodes.into_iter().map(node).collect(), Edges::Mesh(edges))
        }
        Clusters::Points(table) => {
            let node = |cluster: &'a PointCluster| Node { id: cluster.cluster, cluster: NodeRow::Points(cluster) };
            (table.rows.iter().map(node).collect(), Edges::Points(&table.edges))
        }
    };
    let graph = NodeLink { tesserae: 1, directed: false, multigraph: false, nodes, edges };
    Ok(Box::new(move |out| {
        serde_json::to_writer(&mut *out, &graph)?;
        out.write_all(b"\n")
    }))
}

/// Pairs of clusters with what they share: a length, or a number of pairs of items.
fn shared(clusters: &Clusters<'_>) -> Vec<(u32, u32, f64)> {
    match clusters {
        Clusters::Mesh(graph) => graph.edges.iter().map(|edge| (edge.source, edge.target, edge.length)).collect(),
        Clusters::Points(table) => {
            table.edges.iter().map(|edge| (edge.source, edge.target, edge.pairs as f64)).collect()
        }
    }
}

/// What `scipy.sparse.load_npz` reads: a symmetric matrix of lengths or numbers of pairs, rows compressed.
fn matrix<'a>(content: &Content<'a>) -> Result<Encoding<'a>> {
    let clusters = Clusters::of(content)?;
    let size = match &clusters {
        Clusters::Mesh(graph) => graph.nodes.len(),
        Clusters::Points(table) => table.rows.len(),
    };
    let edges = shared(&clusters);
    let mut entries: Vec<(u32, u32, f64)> = Vec::with_capacity(2 * edges.len());
    for (source, target, value) in edges {
        entries.push((source, target, value));
        entries.push((target, source, value));
    }
    entries.sort_unstable_by_key(|&(row, column, _)| (row, column));
    let mut begin = vec![0; size + 1];
    entries.iter().for_each(|&(row, _, _)| begin[row as usize + 1] += 1);
    for row in 0..size {
        begin[row + 1] += begin[row];
    }
    let columns: Vec<i32> = entries.iter().map(|&(_, column, _)| column as i32).collect();
    let values: Vec<f64> = entries.iter().map(|&(_, _, value)| value).collect();
    let size = size as i64;
    let arrays = [
        ("indices", Array::i32(&[columns.len()], &columns)),
        ("indptr", Array::i32(&[begin.len()], &begin)),
        ("format", Array::bytes(b"csr")),
        ("shape", Array::i64(&[2], &[size, size])),
        ("data", Array::f64(&[values.len()], &values)),
    ];
    Ok(Box::new(move |out| npz::write(out, &arrays)))
}

fn graphml<'a>(content: &Content<'a>) -> Result<Encoding<'a>> {
    let clusters = Clusters::of(content)?;
    Ok(Box::new(move |out| write_graphml(out, &clusters)))
}

fn write_graphml(out: &mut dyn Write, clusters: &Clusters<'_>) -> io::Result<()> {
    writeln!(out, "<?xml version=\"1.0\" encoding=\"UTF-8\"?>")?;
    writeln!(out, "<graphml xmlns=\"http://graphml.graphdrawing.org/xmlns\">")?;
    let mut key = |of: &str, name: &str, kind: &str| {
        writeln!(out, "<key id=\"{name}\" for=\"{of}\" attr.name=\"{name}\" attr.type=\"{kind}\"/>")
    };
    let columns = clusters.columns();
    columns.iter().try_for_each(|(name, kind)| key("node", name, kind))?;
    match clusters {
        Clusters::Mesh(_) => key("edge", "length", "double").and_then(|()| key("edge", "arcs", "long"))?,
        Clusters::Points(_) => key("edge", "pairs", "long")?,
    }
    writeln!(out, "<graph id=\"clusters\" edgedefault=\"undirected\">")?;
    for (node, row) in clusters.rows().into_iter().enumerate() {
        write!(out, "<node id=\"{node}\">")?;
        for ((name, _), value) in columns.iter().zip(row) {
            if let Some(value) = value {
                write!(out, "<data key=\"{name}\">{value}</data>")?;
            }
        }
        writeln!(out, "</node>")?;
    }
    match clusters {
        Clusters::Mesh(graph) => {
            for Edge { source, target, length, arcs } in &graph.edges {
                write!(out, "<edge source=\"{source}\" target=\"{target}\">")?;
                if let Some(length) = number(*length) {
                    write!(out, "<data key=\"length\">{length}</data>")?;
                }
                writeln!(out, "<data key=\"arcs\">{arcs}</data></edge>")?;
            }
        }
        Clusters::Points(table) => {
            for ClusterEdge { source, target, pairs } in &table.edges {
                write!(out, "<edge source=\"{source}\" target=\"{target}\">")?;
                writeln!(out, "<data key=\"pairs\">{pairs}</data></edge>")?;
            }
        }
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
