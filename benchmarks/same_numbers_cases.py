"""The cases of :mod:`benchmarks.same_numbers`: command lines and calls that both trees run."""

from benchmarks.same_numbers_steps import FAULTS, SIMULATIONS, Case, library, printed, run

BALANCING = "{data}/pose2sim/balancing_one_person"
QUALISYS = "--calibration {data}/pose2sim/calibration/Calib.qca.txt --rate-hz 60"
ALONE = f"reconstruct {BALANCING} --keypoints {BALANCING}/pose-associated {QUALISYS} --output {{out}}"
TWO = "{data}/pose2sim/two_people"
TRUTHS = " ".join(f"{TWO}/pose-3d/S00_P01_T02_Participants1-2_{who}_0-100.trc" for who in ("P1", "P2"))
MOUSE = "{data}/sleap_mouse --calibration {data}/sleap_mouse/calibration_0b26179_good.toml"
WRONG_MOUSE = "{data}/sleap_mouse --calibration {data}/sleap_mouse/calibration.toml"
WEBCAMS = "{data}/caliscope_webcams"
PEOPLE = "reconstruct {inputs}/people --output {out}"
FORMATS = "{data}/calibration_formats"
EDITS = "{inputs}/edits/edits.toml"
POSE2SIM = (
    Case(
        "pose2sim_balancing",
        (
            run(f"{ALONE}/result --also parquet anipose deeplabcut sleap movement nwb npz freemocap opensim openpose"),
            run(f"evaluate {{out}}/result {BALANCING}/pose-3d/S00_P00_T01_BalancingTrial_0-100.trc"),
            run("evaluate {out}/result --json {out}/own_account.json"),
            printed(
                "explain {out}/result --frame 50 --recording " + f"{BALANCING} --keypoints {BALANCING}/pose-associated"
            ),
        ),
        "pose2sim",
    ),
    Case(
        "pose2sim_trajectory",
        (
            run(f"{ALONE}/jerk --solve trajectory"),
            run(f"{ALONE}/acceleration --solve trajectory --trajectory.prior acceleration --trajectory.no-bones"),
            run(f"{ALONE}/chunks --solve trajectory --chunk-frames 40"),
        ),
        "pose2sim",
    ),
    Case(
        "pose2sim_filters",
        (
            run(
                f"{ALONE}/all --solve frame --postprocess.fill pchip --postprocess.smooth hampel median butterworth "
                "savgol one_euro kalman --postprocess.rigid-bones --postprocess.drop-beyond-px 40"
            ),
            run(f"{ALONE}/kalman --solve frame --postprocess.fill smoother --postprocess.smooth kalman"),
            run(f"{ALONE}/linear --solve frame --postprocess.fill linear --postprocess.smooth butterworth"),
        ),
        "pose2sim",
    ),
    Case(
        "pose2sim_align",
        (
            run(
                f"{ALONE}/opensim --align.floor feet --align.origin subject --align.forward subject "
                "--align.preset opensim --align.height-m 1.7 --subject.mass-table de_leva_female --subject.mass-kg 60"
            ),
            run(f"{ALONE}/unreal --align floor --align.preset unreal --subject.mass-table winter"),
            run(
                f"{ALONE}/given --align.floor-points-m 0 0 0.01 1 0 0.02 0 1 0 --align.origin-m 0.1 0.2 0 "
                "--align.forward-m 0 1 0 --align.length-m 0.4 --align.length-between left_hip left_knee"
            ),
        ),
        "pose2sim",
    ),
    Case(
        "pose2sim_methods",
        (
            run(
                f"{ALONE}/freemocap --pairs labels --triangulation.method weighted_subsets "
                "--triangulation.weighted-subsets.target-unit normalised "
                "--triangulation.weighted-subsets.target-reprojection-error 0.01"
            ),
            run(f"{ALONE}/percentile --triangulation.method percentile_filter"),
            run(
                f"{ALONE}/ransac --triangulation.method ransac --triangulation.ransac.threshold-unit m "
                "--triangulation.ransac.threshold 0.05"
            ),
            run(f"{ALONE}/exponent --triangulation.confidence-exponent 1 --triangulation.min-views 3"),
            run(ALONE.replace("reconstruct", "compare", 1) + "/compared --no-timing"),
        ),
        "pose2sim",
    ),
    Case(
        "pose2sim_sides",
        (
            run(f"{ALONE}/votes --sides votes"),
            run(f"{ALONE}/plane --sides plane --side-search.facing=-y"),
            run(f"{ALONE}/sds --pairs sds --pair-search.sds.max-iterations 100 --end-s 0.5"),
            run(f"{ALONE}/near --pair-search.prior-m 0.05 --side-search.rounds 2"),
        ),
        "pose2sim",
    ),
    Case(
        "pose2sim_body",
        (
            run(
                f"reconstruct {BALANCING} --keypoints {BALANCING}/pose {QUALISYS} --people one --bodies fit "
                "--pick largest --smoother full --output {out}/full"
            ),
            run(f"{ALONE}/lag --people one --bodies fit --smoother lag"),
        ),
        "pose2sim",
    ),
    Case(
        "pose2sim_one_camera",
        (run(f"{ALONE}/flat --cameras cam_01"), run(f"{ALONE}/two_cameras --cameras cam_01 cam_03")),
        "pose2sim",
    ),
    Case(
        "pose2sim_static",
        (
            run(
                "reconstruct {data}/pose2sim/static_one_person --keypoints "
                "{data}/pose2sim/static_one_person/pose-associated --rate-hz 60 --output {out}/result "
                "--calibration {data}/pose2sim/calibration/Calib_qualisys.toml"
            ),
        ),
        "pose2sim",
    ),
    Case(
        "pose2sim_two_people",
        (
            run(
                f"reconstruct {TWO} --keypoints {TWO}/pose {QUALISYS} --people many --noise-scale-px 10 "
                "--solve trajectory --output {out}/result"
            ),
            run(f"evaluate {{out}}/result {TRUTHS}"),
            run(f"evaluate {{out}}/result {TRUTHS} --layer measured --head-rule shelf --json {{out}}/measured.json"),
            run(f"edit {{out}}/result {EDITS} --output {{out}}/edited"),
            printed(f"explain {{out}}/result --frame 40 --recording {TWO} --keypoints {TWO}/pose"),
        ),
        "pose2sim",
    ),
    Case(
        "pose2sim_two_associated",
        (
            run(
                f"reconstruct {TWO} --keypoints {TWO}/pose-associated {QUALISYS} --people many --solve frame "
                "--output {out}/result --postprocess.smooth butterworth"
            ),
        ),
        "pose2sim",
    ),
    Case(
        "pose2sim_calibration",
        (
            run(
                f"refine-calibration {BALANCING} --keypoints {BALANCING}/pose-associated {QUALISYS} "
                "--output {out}/refined.qca.txt",
                printed=True,
            ),
            printed(f"inspect --deep {BALANCING} --keypoints {BALANCING}/pose-associated {QUALISYS}"),
            run(f"convert {BALANCING}/pose-associated {{out}}/keypoints.nc --rate-hz 60"),
            run(f"convert {BALANCING}/pose-associated {{out}}/openpose --to openpose"),
            run(f"convert {BALANCING}/pose {{out}}/everyone.csv --rate-hz 60 --onto body_20"),
            run(f"convert {BALANCING}/pose {{out}}/everyone.jsonl --rate-hz 60"),
            run("convert {data}/pose2sim/calibration/Calib.qca.txt {out}/anipose.toml --to anipose"),
            run("convert {data}/pose2sim/calibration/Calib.qca.txt {out}/pose2sim.toml --to pose2sim"),
        ),
        "pose2sim",
    ),
)
REAL = (
    Case(
        "caliscope_webcams",
        (
            run(f"reconstruct {WEBCAMS} --output {{out}}/result"),
            run(f"sync {WEBCAMS} --output {{out}}/sync.toml", printed=True),
            run(f"reconstruct {WEBCAMS} --sync {{out}}/sync.toml --output {{out}}/in_step --solve trajectory"),
            run(f"calibrate-noise {WEBCAMS} --output {{out}}/noise.toml", printed=True),
            run(f"reconstruct {WEBCAMS} --options {{out}}/noise.toml --output {{out}}/noise --chunk-frames 100"),
            run(f"refine-calibration {WEBCAMS} --output {{out}}/refined.toml", printed=True),
            printed(f"inspect --deep {WEBCAMS}"),
        ),
        "caliscope_webcams",
    ),
    Case(
        "sleap_mouse",
        (
            run(f"reconstruct {MOUSE} --rate-hz 30 --solve trajectory --output {{out}}/one"),
            run(f"reconstruct {MOUSE} --rate-hz 60 --people many --output {{out}}/many"),
            run(f"reconstruct {WRONG_MOUSE} --rate-hz 30 --output {{out}}/wrong"),
            printed(f"inspect --deep {MOUSE}"),
            printed(f"inspect --deep {WRONG_MOUSE}"),
            run(f"refine-calibration {WRONG_MOUSE} --output {{out}}/board.toml --from board --relocate side", True),
        ),
        "sleap_mouse",
    ),
    Case(
        "fly_3cam",
        (
            run(
                "reconstruct {data}/fly_3cam --keypoints '{data}/fly_3cam/*rng=0.csv' --rate-hz 300 "
                "--length-unit mm --solve trajectory --output {out}/one"
            ),
            run(
                "reconstruct {data}/fly_3cam --keypoints '{data}/fly_3cam/*rng=1.csv' --rate-hz 300 --people many "
                "--output {out}/many --end-s 0.7"
            ),
        ),
        "fly_3cam",
    ),
    Case(
        "deepfly_7cam",
        (
            run(
                "reconstruct {data}/deepfly_7cam --rate-hz 100 --people one --bodies fit --pairs labels "
                "--exclude-camera 3 --length-unit mm --output {out}/fit --tracker.births.min-age-s 0.025 "
                "--tracker.births.min-age-two-views-s 0.045"
            ),
            run("reconstruct {data}/deepfly_7cam --rate-hz 100 --length-unit mm --output {out}/all"),
        ),
        "deepfly_7cam",
    ),
    Case(
        "dannce_mouse",
        (
            run(
                "reconstruct {data}/dannce_mouse --rate-hz 30 --people one --solve frame --bodies fit "
                "--output {out}/result"
            ),
            run("convert {data}/dannce_mouse/label3d_demo.mat {out}/cameras.toml"),
        ),
        "dannce_mouse",
    ),
    Case(
        "mvor",
        (
            run(
                "reconstruct {data}/mvor --calibration {data}/mvor/camma_mvor_2018.json --keypoints "
                "{data}/mvor/openpose_kps.json --people many --bodies none --rate-hz 1 --end-s 200 "
                "--output {out}/result"
            ),
            run("convert {data}/mvor/openpose_kps.json {out}/detected.parquet --rate-hz 1"),
        ),
        "mvor",
    ),
    Case(
        "mouse_outdoor_12cam",
        (
            library("reconstruct {inputs}/outdoor {out}/result people=one"),
            library("reconstruct {inputs}/outdoor {out}/wide people=one noise_scale_px=30"),
            run("refine-calibration {inputs}/outdoor --people one --output {out}/refined.toml", printed=True),
            library("reconstruct {inputs}/outdoor {out}/refined people=one CALIBRATION={out}/refined.toml"),
        ),
        "mouse_outdoor_12cam",
        note="5,000 of 176,868 points. At the base, reconstruct and inspect --deep never finish on this folder.",
    ),
    Case(
        "panoptic_motion",
        (
            run("reconstruct {inputs}/panoptic_one --people many --output {out}/many"),
            run("reconstruct {inputs}/panoptic_one --people one --pick largest --output {out}/one"),
        ),
        "panoptic_motion",
    ),
    Case(
        "panoptic_three_people",
        (
            run("reconstruct {inputs}/panoptic_three --people many --output {out}/result"),
            run("evaluate {out}/result {inputs}/panoptic_three/truth.nc"),
        ),
        "panoptic_three_people",
    ),
    Case(
        "calibration_formats",
        (
            run(f"convert {FORMATS}/easymocap {{out}}/easymocap.toml"),
            run(f"convert {FORMATS}/avian/utils/extrinsic_calib_v2.yaml {{out}}/kalibr.toml"),
            run(f"convert {FORMATS}/acinoset_fisheye/4_cam_scene_sba_thursday_kiara.json {{out}}/acinoset.toml"),
            printed(f"inspect {FORMATS}"),
        ),
        "calibration_formats",
    ),
)
SIMULATED = (
    Case(
        "simulate",
        tuple(run(f"{command} --output {{out}}/{name}") for name, command in SIMULATIONS.items()),
        note="Compares what simulate and simulate-people write; other cases read only what the base wrote.",
    ),
    Case(
        "simulated_one",
        (
            run("reconstruct {inputs}/one --output {out}/result"),
            run("evaluate {out}/result {inputs}/one/truth.nc"),
            run("evaluate {out}/result --json {out}/own_account.json"),
            run("reconstruct {inputs}/one --bodies fit --people one --output {out}/fit --end-s 8"),
            run("compare {inputs}/one --output {out}/compared --no-timing --truth {inputs}/one/truth.nc --end-s 6"),
            run("calibrate-noise {inputs}/one --output {out}/noise.toml", printed=True),
            library("triangulate {inputs}/one {out}/methods people=one"),
        ),
    ),
    Case(
        "simulated_late",
        (
            run("sync {inputs}/late --output {out}/sync.toml", printed=True),
            run("reconstruct {inputs}/late --sync {out}/sync.toml --output {out}/result"),
            run("evaluate {out}/result {inputs}/late/truth.nc"),
            printed("inspect --deep {inputs}/late"),
        ),
    ),
    Case(
        "simulated_creature",
        (
            run("reconstruct {inputs}/creature --output {out}/one"),
            run("reconstruct {inputs}/creature --triangulation.method irls --solve trajectory --output {out}/irls"),
        ),
    ),
    Case(
        "simulated_people",
        (
            run(f"{PEOPLE}/result"),
            run("evaluate {out}/result {inputs}/people/truth.nc"),
            run("evaluate {out}/result {inputs}/people/truth.nc --layer model --states active --json {out}/model.json"),
            printed("explain {out}/result --frame 200 --recording {inputs}/people"),
            run("convert {out}/result {out}/model.parquet --layer model"),
        ),
    ),
    Case(
        "simulated_trackers",
        (
            run(f"{PEOPLE}/specification --tracker.preset specification --smoother none --end-s 10"),
            run(f"{PEOPLE}/lag --smoother lag --max-people 3 --end-s 10"),
            run(f"{PEOPLE}/none --smoother none --tracker.iterations 3 --end-s 10"),
            run(f"{PEOPLE}/chunks --chunk-frames 100 --solve trajectory --end-s 10"),
            run(f"{PEOPLE}/no_bodies --bodies none --solve frame --postprocess.smooth kalman --end-s 10"),
            run(f"{PEOPLE}/rpt --association.method rpt --end-s 10"),
            run(f"{PEOPLE}/kept --person person_1 person_2 --end-s 10"),
        ),
    ),
    Case(
        "simulated_identities",
        (
            run("reconstruct {inputs}/people_ids --people many --output {out}/result"),
            run("evaluate {out}/result {inputs}/people_ids/truth.nc"),
        ),
    ),
    Case(
        "simulated_mice",
        (
            run("reconstruct {inputs}/mice/whole --people many --output {out}/whole"),
            run("evaluate {out}/whole {inputs}/mice/whole/truth.nc"),
            run(
                "reconstruct {inputs}/mice/edges --people many --skeleton {inputs}/mice/my_mouse.toml "
                "--output {out}/edges"
            ),
            run("reconstruct {inputs}/mice/list --people many --output {out}/list"),
        ),
    ),
    Case(
        "simulated_133",
        (
            run("reconstruct {inputs}/body_133 --output {out}/result"),
            run("evaluate {out}/result {inputs}/body_133/truth.nc"),
        ),
    ),
    Case(
        "live",
        (
            library("track {inputs}/frames {out} skeleton=body_20 people=many"),
            run("replay {inputs}/people --end-s 10", writes="lines.jsonl"),
            run(
                "stream --calibration {inputs}/people/calibration.toml --skeleton body_20 --clock messages",
                reads="lines.jsonl",
                writes="stream.jsonl",
            ),
        ),
    ),
    Case(
        "faults",
        (
            *(printed(f"inspect --deep {{inputs}}/faults/{name}") for name in FAULTS),
            run("sync {inputs}/faults/bumped_drift --output {out}/drift.toml", printed=True),
            run("sync {inputs}/faults/moved_dropped --output {out}/dropped.toml", printed=True),
            run("refine-calibration {inputs}/faults/turned_late --output {out}/turned.toml", printed=True),
            run("refine-calibration {inputs}/faults/order --output {out}/order.toml --fix cam_3 cam_4", printed=True),
            run("refine-calibration {inputs}/wand --people one --output {out}/lens.toml --refine lens", True),
        ),
    ),
    Case(
        "batch",
        (
            run("batch {inputs}/late {inputs}/creature --jobs 1 --end-s 3 --output {out}/results"),
            run("init {out}/options.toml"),
        ),
    ),
)
CASES = (*POSE2SIM, *REAL, *SIMULATED)
UNREAD = {
    "caliscope_charuco": "videos of a board only: nothing that posefuse reads as 2D keypoints",
    "pose2sim_videos": "videos only, which overlay draws on: pictures are not compared",
}
"""Folders of recordings that no case reads, with the reason."""
