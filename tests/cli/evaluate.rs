//! `tesserae evaluate paper` from outside, on samples that go by the names of the paper's meshes.

use crate::command::Folder;

#[test]
fn the_papers_tables_figure_and_statements_come_out_for_the_meshes_that_are_there() {
    let folder = Folder::new();
    std::fs::create_dir(folder.path("meshes")).expect("a folder");
    folder.sample("sphere", 4000, "meshes/my-Bunny.obj");
    folder.sample("knot", 4000, "meshes/horse.glb");
    folder.write("meshes/armadillo.txt", "no mesh");
    folder.run(&["evaluate", "paper", "--meshes", "meshes", "--repeats", "1", "out/paper"]).expect_success();
    let report = String::from_utf8(folder.read("out/paper/report.md")).expect("text");
    for words in [
        "my-Bunny.obj, 4000 faces (**the paper's has 70k",
        "horse.glb",
        "Armadillo: not found",
        "| Bunny, 1000 | 3000 | 172 |",
        "| Armadillo, 5000 | 16000 | 891 | no mesh |",
        "| Horse | 710 | 283 | 5 |",
        "no gpu took part",
        "(figure-6.svg)",
        "BB ends slightly above ACVD",
        "| kept |",
        "| not checked |",
    ] {
        assert!(report.contains(words), "{words:?} is not in:\n{report}");
    }
    // every row has as many cells as the head of its table
    let mut cells = 0;
    for line in report.lines() {
        let count = line.matches('|').count();
        if cells != 0 && count != 0 {
            assert_eq!(count, cells, "{line}");
        }
        cells = count;
    }
    let figure = String::from_utf8(folder.read("out/paper/figure-6.svg")).expect("text");
    for name in ["HR", "ML", "PML", "PML/1633 ML", "ACVD", "VC", "BB", "BB refined", "default settings"] {
        assert!(figure.contains(name), "{name}");
        assert!(report.contains(name), "{name}");
    }
}

#[test]
fn without_meshes_it_says_which_it_looked_for() {
    let folder = Folder::new();
    folder.sample("sphere", 4000, "ball.obj");
    folder.run(&["evaluate", "paper", "--meshes", ".", "out"]).expect_failure(&["bunny", "horse", "armadillo"]);
    folder.run(&["evaluate", "paper", "--meshes", "gone", "out"]).expect_failure(&["gone"]);
    folder.run(&["evaluate", "paper", "out"]).expect_usage_error(&["--meshes"]);
    folder.run(&["evaluate"]).expect_usage_error(&["paper"]);
}
