//! Points with neighbours: arrays, edges in files, images, and their outputs.

use tesserae_mesh::artifacts::npy_header;
use tesserae_mesh::export::npz::{Array, write};

use crate::command::Folder;

/// Items of a picture: three stripes with a step in them.
fn values(rows: usize, columns: usize) -> Vec<f32> {
    let value = |at: usize| {
        let (row, column) = (at / columns, at % columns);
        [(row / 4) as f32, column as f32 / 8.0, if row * 3 > column { 5.0 } else { 0.0 }]
    };
    (0..rows * columns).flat_map(value).collect()
}

fn npy(shape: &str, values: &[f32]) -> Vec<u8> {
    let mut bytes = npy_header("<f4", shape);
    bytes.extend(values.iter().flat_map(|value| value.to_le_bytes()));
    bytes
}

/// Runs a command line whose words have no blanks.
fn run(folder: &Folder, command: &str) -> String {
    String::from_utf8(folder.run(&command.split(' ').collect::<Vec<_>>()).expect_success()).expect("text")
}

#[test]
fn a_grid_gives_labels_in_its_shape_and_tables_without_a_mesh() {
    let folder = Folder::new();
    folder.write("x.npy", npy("(12, 20, 3)", &values(12, 20)));
    let said = run(
        &folder,
        "cluster x.npy -k 6 --graph grid -o l.npy -o l.json --clusters-table t.json --clusters-graph g.json",
    );
    assert!(said.starts_with("6 clusters of 240 items"), "{said}");
    let labels = folder.read("l.npy");
    assert!(String::from_utf8_lossy(&labels[..128]).contains("(12, 20)"));
    let labels: Vec<u32> =
        labels[labels.len() - 960..].as_chunks::<4>().0.iter().map(|word| u32::from_le_bytes(*word)).collect();
    let report = folder.json("l.json");
    assert_eq!(report["input"]["graph"], "grid");
    assert_eq!((&report["input"]["edges"], &report["input"]["dimensions"]), (&(12 * 19 + 11 * 20).into(), &3.into()));
    assert!(report["energy"]["explained"].as_f64() > Some(0.5), "{report}");
    let table = folder.json("t.json");
    let rows = table["clusters"].as_array().expect("rows");
    let energy: f64 = rows.iter().map(|row| row["energy"].as_f64().expect("a number")).sum();
    assert!((energy / report["energy"]["final"].as_f64().expect("a number") - 1.0).abs() < 1e-9);
    for (cluster, row) in rows.iter().enumerate() {
        let items = labels.iter().filter(|&&label| label as usize == cluster).count();
        assert_eq!((&row["items"], row["mean"].as_array().expect("a mean").len()), (&items.into(), 3));
    }
    let graph = folder.json("g.json");
    let pairs: u64 =
        graph["edges"].as_array().expect("edges").iter().map(|edge| edge["pairs"].as_u64().expect("pairs")).sum();
    let across = |a: usize, b: usize| usize::from(labels[a] != labels[b]);
    let expected: usize = (0..240)
        .map(|at| if at % 20 > 0 { across(at, at - 1) } else { 0 } + if at >= 20 { across(at, at - 20) } else { 0 })
        .sum();
    assert_eq!(pairs as usize, expected);

    run(&folder, "cluster x.npy --algorithm pml -k 6,3 --graph grid --clusters-table t-{k}.csv -o c-{k}.npy");
    let csv = String::from_utf8(folder.read("t-3.csv")).expect("text");
    assert!(csv.starts_with("cluster,items,weight,energy,neighbours,component,mean_0,mean_1,mean_2\n"), "{csv}");
    assert_eq!(csv.lines().count(), 4);
    assert!(String::from_utf8_lossy(&folder.read("c-6.npy")[..128]).contains("(12, 20)"));
}

#[test]
fn cuts_of_masked_points_have_their_shape_and_no_label_where_the_mask_is() {
    let folder = Folder::new();
    let takes_part: Vec<u8> = (0..240).map(|item| u8::from(item % 20 != 7 || item < 60)).collect();
    let values = Array::f64(&[12, 20, 3], &values(12, 20).into_iter().map(f64::from).collect::<Vec<_>>());
    let mut bytes = Vec::new();
    write(&mut bytes, &[("X", values), ("mask", Array::u8(&[12, 20], takes_part.clone()))]).expect("bytes");
    folder.write("x.npz", bytes);
    run(&folder, "cluster x.npz --algorithm pml -k 5 --graph grid -o of-run.npy --hierarchy t.tsr");
    let said = run(&folder, "cut t.tsr --clusters 5 -o of-cut.npy");
    assert!(said.starts_with("5 clusters of 231 items, "), "{said}");
    let labels = folder.read("of-cut.npy");
    assert_eq!(labels, folder.read("of-run.npy"));
    assert!(String::from_utf8_lossy(&labels[..128]).contains("(12, 20)"));
    let words = labels[labels.len() - 960..].as_chunks::<4>().0;
    assert!(words.iter().zip(takes_part).all(|(&word, takes_part)| (word == [0xff; 4]) == (takes_part == 0)));
}

#[test]
fn edges_of_a_sparse_matrix_are_those_of_the_nearest_neighbours_that_it_lists() {
    let folder = Folder::new();
    folder.write("x.npy", npy("(240, 3)", &values(12, 20)));
    run(&folder, "cluster x.npy -k 8 --graph knn:6 -o near.npy");
    // the graph of clusters, one an item, is that of the items
    run(&folder, "cluster x.npy -k 240 --graph knn:6 --clusters-graph items.npz -o all.npy");
    run(&folder, "cluster x.npy -k 8 --graph items.npz -o listed.npy -o listed.json");
    assert_eq!(folder.read("near.npy"), folder.read("listed.npy"));
    assert_eq!(folder.json("listed.json")["input"]["graph"], "edges");
}

#[test]
fn a_run_that_writes_nothing_advises_what_points_and_images_have() {
    let folder = Folder::new();
    folder.write("x.npy", npy("(12, 20, 3)", &values(12, 20)));
    let points = run(&folder, "cluster x.npy -k 6 --graph grid");
    assert!(points.ends_with("nothing was written: add -o x.npy (labels)\n"), "{points}");
    run(&folder, "cluster x.npy -k 6 --graph grid -o i.png");
    let image = run(&folder, "cluster i.png -k 6");
    let advice = "nothing was written: add -o i-labels.png (labels) or --means i-means.png (to look at)\n";
    assert!(image.ends_with(advice), "{image}");
    run(&folder, "cluster i.png -k 6 -o i-labels.png --means i-means.png");
}

#[test]
fn what_points_do_not_have_is_refused() {
    let folder = Folder::new();
    folder.sample("quads", 400, "q.obj");
    folder.write("x.npy", npy("(12, 20, 3)", &values(12, 20)));
    folder.write("flat.npy", npy("(240, 3)", &values(12, 20)));
    folder.write("half.npy", npy("(120, 3)", &values(6, 20)));
    folder.write("two.npy", npy("(2,)", &[1.0; 2]));
    folder.write("negative.npy", npy("(240,)", &[-1.0; 240]));
    run(&folder, "cluster flat.npy -k 240 --clusters-graph items.npz -o all.npy");
    for (command, words) in [
        ("cluster flat.npy -k 4 --weights two.npy", "tesserae: two.npy: the weights must have the shape of the items"),
        ("cluster flat.npy -k 4 --weights negative.npy", "tesserae: negative.npy: weights must be finite and above 0"),
        ("cluster two.npy -k 1 --graph items.npz", "tesserae: two.npy: points must be an array of items × columns"),
        ("cluster half.npy -k 4 --graph items.npz", "tesserae: items.npz: the graph must have a row for each of 120"),
        ("cluster x.npy -k 4 --graph grid --mesh m.glb", "--mesh is made of a mesh, and these are points"),
        ("cluster x.npy -k 4 --graph grid --remesh m.ply", "--remesh is made of a mesh"),
        ("cluster x.npy -k 4 -o l.npy", "items × columns, as X.reshape(-1, d) makes it, or a grid"),
        ("cluster flat.npy -k 4 --graph grid -o l.npy", "2 or 3 dimensions"),
        ("cluster flat.npy -k 4 --graph knn:0 -o l.npy", "from 1 to 64"),
        ("cluster flat.npy -k 4 --graph q.obj -o l.npy", "--graph must be knn, knn:Q, grid, grid:full or FILE.npz"),
        ("cluster flat.npy -k 4 --graph none.npz -o l.npy", "none.npz"),
        ("cluster flat.npy -k 4 --compactness 3 -o l.npy", "--compactness goes with images"),
        ("cluster flat.npy -k 4 --curvature-exponent 3 -o l.npy", "goes with meshes, not with points"),
        ("cluster q.obj -k 4 --graph knn:8 -o l.npy", "--graph goes with points, not with a mesh"),
        ("cluster flat.npy -k 8 -o l.png", "-o l.png is of labels in rows and columns"),
        ("cluster q.obj -k 4 -o l.png", "-o l.png is of labels in rows and columns"),
        ("cluster q.obj -k 4 --means m.png", "--means is made of an image"),
        ("cluster flat.npy -k 8 --means m.png", "--means is made of an image"),
        ("export flat.npy --labels x.npy -o c.ply", "these are points, not a mesh"),
    ] {
        let done = folder.run(&command.split(' ').collect::<Vec<_>>());
        assert!(done.status != Some(0) && done.stderr.contains(words), "{command}: {done:?}");
    }
}
