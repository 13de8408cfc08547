use tesserae::device::{cpu::CpuDevice, *};
use tesserae::job::*;
use tesserae::mesh::*;
use tesserae::parameters::*;
#[test]
fn exp() {
    let file = std::env::var("F").unwrap();
    let ks = std::env::var("K").unwrap();
    let bytes = std::fs::read(&file).unwrap();
    for k in ks.split(',') {
        for seeds in [Seeds::Morton, Seeds::Random] {
            for seed in 0..2 {
                for refine in [Refine::None, Refine::On] {
                    let parameters = Parameters {
                        clusters: Some(k.parse().unwrap()),
                        seeds: seeds.clone(),
                        seed,
                        refine,
                        ..Default::default()
                    };
                    let p = prepare(&Request {
                        bytes: &bytes,
                        format: Format::Obj,
                        resources: &NoResources,
                        limits: Limits::default(),
                        parameters: &parameters,
                        seeds: None,
                    })
                    .unwrap();
                    let mut d = CpuDevice::new();
                    let o = run(&p, &mut d, &Cancel::default(), &mut |_| {}).unwrap();
                    let r = o.report;
                    let n = |ph| r.iterations.iter().filter(|i| i.phase == ph).count();
                    use tesserae::report::Phase::*;
                    println!(
                        "k={k} {seeds:7} {seed} refine={refine:?} E={:e} hex={:.4} it b={} r={} rep={} parse={:.1} topo={:.1} cluster={:.1} dl={:.1}",
                        r.energy.final_.unwrap(),
                        r.energy.hexagon_ratio.unwrap_or(0.),
                        n(Boundary),
                        n(Refine),
                        n(Repair),
                        r.timings_ms.parse,
                        r.timings_ms.topology,
                        r.timings_ms.cluster,
                        r.timings_ms.download
                    );
                }
            }
        }
    }
}
