%PLATE G71 *
; ph-post VERSION compensated this program
; ph-post: original sha256 3d19147516fb3787da19def8c6b14b0b2d222972885b8015f54d61a9ba016909
; ph-post: machine stepper router, sha256 4c3cf1243d64a44b
; ph-post: options sha256 0000000000000000
; ph-post: dialect heidenhain-iso
; ph-post: offset X 0.03 mm
; ph-post: offset Y 0.04 mm
; ph-post: take-up X 0.12 mm
; ph-post: take-up Y 0.16 mm
; ph-post: 2 stops, 0 dips
; ph-post: 9 crossings, up to 1.1314 mm long, within 0.0024 mm
; ph-post: dwell 0 s, decimals 4, chord tolerance 0.001 mm, block time 5 ms
; ph-post: note holds for work offsets that are not rotated, mirrored or scaled
; ph-post: note holds where friction holds the axes against the cut
N10 G30 G17 X-40 Y-40 Z-20 *
N20 G31 G90 X+40 Y+40 Z+0 *
N30 T5 G17 S3000 *
N40 G00 G40 G90 Z+100 M3 *
; ph-post: +3 -1 restart here, X approach, Y approach
N50 X-20.09 Y+0.12 *
G01 X-19.97 F232.3 *
G01 Y-0.04 F240 *
; ph-post: +1 -1 mode
N60 G00 Z+2 M8 *
N70 G01 Z-2 F200 *
N80 I+0 J+0 *
; ph-post: +29 -5 crossing Y+, crossing X-, crossing Y-, crossing X+
N90 I+0.03 J-0.04 *
G03 X-0.5098 Y-20.0327 F1200 *
G01 X-0.2055 Y-20.0409 F1199 *
G01 X+0.03 Y-20.0211 F900.1 *
N100 G01 X+0.125 Y-19.9808 F966.9 * ; second quarter
G01 X+0.2655 Y-19.9609 F905.3 *
G01 X+0.5698 Y-19.9527 F1199 *
I+0.03 J+0.04 *
G03 X+20.0227 Y-0.4998 F1200 *
G01 X+20.0309 Y-0.1982 F1199 *
G01 X+20.0161 Y+0.04 F1173 *
N110 G01 X+19.9857 Y+0.1419 F1217 *
G01 X+19.9709 Y+0.2782 F1178 *
G01 X+19.9627 Y+0.5798 F1199 *
I-0.03 J+0.04 *
G03 X+0.5098 Y+20.0327 F1200 *
G01 X+0.2055 Y+20.0409 F1199 *
G01 X-0.03 Y+20.0211 F900.1 *
N120 G01 X-0.125 Y+19.9808 F966.9 *
G01 X-0.2655 Y+19.9609 F905.3 *
G01 X-0.5698 Y+19.9527 F1199 *
I-0.03 J-0.04 *
G03 X-20.03 Y-0.04 F1200 *
N130 G01 X-20.15 F1200 *
G01 X-21.2814 Y+0.04 F1202 *
G01 X-30.03 F1200 *
G01 X-29.97 F232.3 *
I+0 J+0 *
G01 F1200 *
N160 G01 X+10.03 Y+10.04 F1000 *
N170 X+20.03 *
N180 Y+20.04 *
N190 G02 X+30.03 Y+30.04 R+10 *
; ph-post: +17 -1 crossing Y-, crossing X-
N200 G02 X+39.6484 Y+40.0327 R+10 *
G01 X+39.845 Y+40.0402 F999.5 *
G01 X+39.9268 Y+40.0324 F637 *
G01 X+40.0086 Y+40.0137 F649.2 *
G01 X+40.0826 Y+39.9868 F670.9 *
G01 X+40.1488 Y+39.9699 F652.6 *
G01 X+40.215 Y+39.9602 F640.5 *
G01 X+40.4116 Y+39.9527 F999.5 *
G02 X+50.0227 Y+30.3416 R+10 F1000 *
G01 X+50.0301 Y+30.1472 F999.5 *
G01 X+50.0246 Y+30.0617 F830.1 *
G01 X+50.0103 Y+29.9763 F839.1 *
G01 X+49.99 Y+29.9015 F855.5 *
G01 X+49.9775 Y+29.8371 F842.4 *
G01 X+49.9701 Y+29.7728 F833.5 *
G01 X+49.9627 Y+29.5784 F999.5 *
G02 X+39.97 Y+19.96 R+10 F1000 *
N210 G01 X-0.03 Y-0.04 M9 *
; ph-post: +2 -0 crossing X+
G01 X+0.03 F232.3 *
G01 F1000 *
N220 X+12.53 *
; ph-post: +2 -0 crossing X-
G01 X+12.47 F232.3 *
G01 F1000 *
N230 X+1.97 M5 *
; ph-post: +5 -1 X to 0, Y to 0
N240 G00 Z+100  *
G01 X+2 F116.1 *
G01 Y+0 F120 *
G01 F1000 *
M30 *
; ph-post: undo 1/3 …
; ph-post: undo 2/3 …
; ph-post: undo 3/3 …
N99999999 %PLATE G71 *
