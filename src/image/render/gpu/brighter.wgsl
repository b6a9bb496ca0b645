// The brighter of two images in fixed point, and for every workgroup the light of the fainter one.

struct Frame {
    pixels: u32,
    // Both images are brought to the coarser of their scales.
    kept_shift: u32,
    other_shift: u32,
    electrons_per_unit: f32,
}

@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(1) var<storage, read_write> kept: array<i32>;
@group(0) @binding(2) var<storage, read> other: array<i32>;
@group(0) @binding(3) var<storage, read_write> lost_e: array<f32>;

var<workgroup> fainter: array<f32, WORKGROUP>;

@compute @workgroup_size(WORKGROUP)
fn main(
    @builtin(local_invocation_index) local: u32,
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
) {
    let number = group.y * groups.x + group.x;
    let pixel = number * WORKGROUP + local;
    fainter[local] = 0.0;
    if (pixel < frame.pixels) {
        let a = kept[pixel] >> frame.kept_shift;
        let b = other[pixel] >> frame.other_shift;
        kept[pixel] = max(a, b);
        fainter[local] = f32(min(a, b)) * frame.electrons_per_unit;
    }
    workgroupBarrier();
    if (local == 0u && number < arrayLength(&lost_e)) {
        var sum = 0.0;
        for (var i = 0u; i < WORKGROUP; i++) {
            sum += fainter[i];
        }
        lost_e[number] = sum;
    }
}
